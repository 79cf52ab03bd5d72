/* project.c - see project.h. */
#include "project.h"

#include "../base/file.h"
#include "../base/memory.h"
#include "../base/pool.h"
#include "../scene/scene.h"
#include "colmap.h"
#include "transforms.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum {
    MAX_DOWNSCALE = 64,
    NAMES_IN_LOG = 5 /* of skipped pictures; the rest is counted */
};

static const uint64_t MAX_LIST_BYTES = 1 << 28;

/* Paths. */

char *sf_text_copy(sf_context *ctx, const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = sf_alloc(ctx, size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

char *sf_path_join(sf_context *ctx, const char *folder, const char *name) {
    size_t size = strlen(folder) + strlen(name) + 2;
    char *path = sf_alloc(ctx, size, 1);
    if (path) snprintf(path, size, "%s/%s", folder, name);
    return path;
}

char *sf_path_folder(sf_context *ctx, const char *path) {
    const char *slash = strrchr(path, '/');
    if (!slash) return sf_text_copy(ctx, ".");
    size_t size = (size_t)(slash - path) + 1;
    char *folder = sf_alloc(ctx, size + 1, 1);
    if (folder) snprintf(folder, size + 1, "%s", path);
    return folder;
}

int sf_is_folder(const char *path) {
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

int sf_is_file(const char *path) {
    struct stat st;
    return !stat(path, &st) && S_ISREG(st.st_mode);
}

int sf_holds_file(const char *folder, const char *name) {
    char path[PATH_MAX]; /* a longer one cannot be opened */
    int size = snprintf(path, sizeof path, "%s/%s", folder, name);
    return size > 0 && (size_t)size < sizeof path && sf_is_file(path);
}

int sf_name_stays_inside(const char *name) {
    if (*name == '/') return 0;
    int depth = 0;
    while (*name) {
        size_t length = strcspn(name, "/");
        if (length == 2 && !strncmp(name, "..", 2)) {
            if (--depth < 0) return 0;
        } else if (length > 1 || (length == 1 && *name != '.')) {
            depth++;
        }
        name += length + (name[length] == '/');
    }
    return depth > 0;
}

static const char *without_dot(const char *name) {
    while (!strncmp(name, "./", 2)) name += 2;
    return name;
}

/* Entries. */

static void free_project(sf_project *p) {
    for (size_t i = 0; i < p->count; i++) {
        sf_free(p->ctx, p->entries[i].name);
        sf_free(p->ctx, p->entries[i].path);
        sf_free(p->ctx, p->entries[i].mask);
    }
    sf_free(p->ctx, p->entries);
    sf_free(p->ctx, p->xyz);
    sf_free(p->ctx, p->rgb);
}

sf_status sf_project_add(sf_project *p, const char *file, const char *folder, const char *name,
                         sf_entry **entry) {
    if (!sf_name_stays_inside(name))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: picture name: '%s' is not a path inside its folder", file,
                       name);
    sf_status status = sf_grow(p->ctx, &p->entries, &p->capacity, p->count, p->count + 1, sizeof *p->entries);
    if (status) return status;
    sf_entry *e = &p->entries[p->count++];
    *e = (sf_entry){.name = sf_text_copy(p->ctx, without_dot(name)),
                    .path = sf_path_join(p->ctx, folder, name)};
    *entry = e;
    return e->name && e->path ? SF_OK : SF_ERR_MEMORY;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const sf_entry *)a)->name, ((const sf_entry *)b)->name);
}

sf_status sf_project_sort(sf_project *p, const char *file) {
    if (p->count) qsort(p->entries, p->count, sizeof *p->entries, by_name);
    for (size_t i = 1; i < p->count; i++)
        if (!by_name(&p->entries[i - 1], &p->entries[i]))
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: picture name: '%s' appears twice", file,
                           p->entries[i].name);
    return SF_OK;
}

static int name_of_entry(const void *name, const void *entry) {
    return strcmp(name, ((const sf_entry *)entry)->name);
}

sf_entry *sf_project_find(const sf_project *p, const char *name) {
    if (!p->count) return NULL;
    return bsearch(without_dot(name), p->entries, p->count, sizeof *p->entries, name_of_entry);
}

/* The split. */

static int name_of_text(const void *name, const void *text) {
    return strcmp(name, *(const char *const *)text);
}

static int is_last_part(const char *name, const char *part) {
    const char *slash = strrchr(name, '/');
    return !strcmp(slash ? slash + 1 : name, part);
}

/* How many names the line holds out. */
static size_t hold_out_line(const char *line, size_t count, const char *const *names, sf_split *splits) {
    const char *const *same = bsearch(line, names, count, sizeof *names, name_of_text);
    if (same) {
        splits[same - names] = SF_SPLIT_TEST;
        return 1;
    }
    size_t found = 0;
    for (size_t i = 0; i < count; i++) {
        if (!is_last_part(names[i], line)) continue;
        splits[i] = SF_SPLIT_TEST;
        found++;
    }
    return found;
}

static sf_status hold_out_lines(sf_context *ctx, const char *path, char *text, size_t count,
                                const char *const *names, sf_split *splits) {
    for (unsigned long number = 1; *text; number++) {
        size_t length = strcspn(text, "\n");
        char *line = text;
        text += length + (text[length] == '\n');
        while (length && strchr(" \t\r", line[length - 1])) length--;
        line[length] = 0;
        if (length && !hold_out_line(without_dot(line), count, names, splits))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: line %lu: no picture is named '%s'", path, number,
                           line);
    }
    return SF_OK;
}

static sf_status split_by_list(sf_context *ctx, const char *path, size_t count, const char *const *names,
                               sf_split *splits) {
    uint8_t *text;
    size_t size;
    sf_status status = sf_read_file(ctx, path, MAX_LIST_BYTES, &text, &size);
    if (status) return status;
    for (size_t i = 0; i < count; i++) splits[i] = SF_SPLIT_TRAIN;
    status = hold_out_lines(ctx, path, (char *)text, count, names, splits);
    sf_free(ctx, text);
    return status;
}

sf_status sf_split_names(sf_context *ctx, const sf_load_options *options, size_t count,
                         const char *const *names, sf_split *splits) {
    if (options->test_list) return split_by_list(ctx, options->test_list, count, names, splits);
    for (size_t i = 0; i < count; i++)
        splits[i] = options->hold_out && i % (size_t)options->hold_out == 0 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN;
    return SF_OK;
}

/* The project's own split stands unless the user names a list or wants nothing held out. */
static sf_status choose_splits(sf_project *p, const sf_load_options *options) {
    if (p->has_split && !options->test_list && options->hold_out) return SF_OK;
    const char **names = sf_alloc(p->ctx, p->count, sizeof *names);
    sf_split *splits = sf_alloc(p->ctx, p->count, sizeof *splits);
    sf_status status = SF_ERR_MEMORY;
    if (names && splits) {
        for (size_t i = 0; i < p->count; i++) names[i] = p->entries[i].name;
        status = sf_split_names(p->ctx, options, p->count, names, splits);
        for (size_t i = 0; !status && i < p->count; i++) p->entries[i].split = splits[i];
    }
    sf_free(p->ctx, names);
    sf_free(p->ctx, splits);
    return status;
}

/* From a picture to a view. */

/* The lens for the picture's own size. */
static sf_lens scaled_lens(const sf_entry *e, const sf_picture *p) {
    sf_lens lens = e->lens;
    double x = (double)p->width / e->width, y = (double)p->height / e->height;
    lens.fx *= x;
    lens.cx *= x;
    lens.fy *= y;
    lens.cy *= y;
    return lens;
}

/* Lowers the weights to the mask's. */
static sf_status take_mask(sf_context *ctx, const sf_picture *mask, sf_picture *p) {
    if (mask->width != p->width || mask->height != p->height) {
        snprintf(p->fault, sizeof p->fault, "mask: size: %d x %d is not the picture's %d x %d", mask->width,
                 mask->height, p->width, p->height);
        return SF_ERR_FORMAT;
    }
    size_t n = (size_t)p->width * (size_t)p->height;
    if (!p->weight) {
        p->weight = sf_alloc(ctx, n, 1);
        if (!p->weight) return SF_ERR_MEMORY;
        memset(p->weight, 255, n);
    }
    for (size_t i = 0; i < n; i++)
        if (mask->rgb[i] < p->weight[i]) p->weight[i] = mask->rgb[i];
    return SF_OK;
}

static sf_status apply_mask(sf_context *ctx, const char *path, sf_picture *p) {
    sf_picture mask;
    sf_status status = sf_picture_load(ctx, path, &mask);
    if (status)
        snprintf(p->fault, sizeof p->fault, "mask: %.*s", SF_PICTURE_FAULT_BYTES - 7, mask.fault);
    else
        status = take_mask(ctx, &mask, p);
    sf_picture_free(ctx, &mask);
    return status;
}

/* One pixel of the view: the mean over a box of the picture, by weight where that is known. */
static void average_box(const sf_picture *p, size_t x, size_t y, size_t factor, const sf_view *v) {
    size_t from_plane = (size_t)p->width * (size_t)p->height, at = y * (size_t)v->camera.width + x;
    size_t to_plane = (size_t)v->camera.width * (size_t)v->camera.height;
    uint32_t sum[3] = {0}, weighted[3] = {0}, weight = 0, n = (uint32_t)(factor * factor);
    for (size_t i = 0; i < n; i++) {
        size_t from = (y * factor + i / factor) * (size_t)p->width + x * factor + i % factor;
        uint32_t w = p->weight ? p->weight[from] : 0;
        weight += w;
        for (size_t c = 0; c < 3; c++) {
            sum[c] += p->rgb[c * from_plane + from];
            weighted[c] += w * p->rgb[c * from_plane + from];
        }
    }
    for (size_t c = 0; c < 3; c++)
        v->rgb[c * to_plane + at] =
            (uint8_t)(weight ? (weighted[c] + weight / 2) / weight : (sum[c] + n / 2) / n);
    if (v->weight) v->weight[at] = (uint8_t)((weight + n / 2) / n);
}

static void fill_view(const sf_picture *p, int factor, const sf_view *v) {
    size_t plane = (size_t)p->width * (size_t)p->height;
    if (factor == 1) {
        memcpy(v->rgb, p->rgb, 3 * plane);
        if (v->weight) memcpy(v->weight, p->weight, plane);
        return;
    }
    for (size_t y = 0; y < (size_t)v->camera.height; y++)
        for (size_t x = 0; x < (size_t)v->camera.width; x++) average_box(p, x, y, (size_t)factor, v);
}

static sf_camera pinhole(const sf_entry *e, const sf_lens *lens, const sf_picture *p) {
    sf_camera camera = {.width = p->width,
                        .height = p->height,
                        .fx = lens->fx,
                        .fy = lens->fy,
                        .cx = lens->cx,
                        .cy = lens->cy};
    memcpy(camera.R_cw, e->R_cw, sizeof camera.R_cw);
    memcpy(camera.t_cw, e->t_cw, sizeof camera.t_cw);
    return camera;
}

typedef struct result {
    sf_view *view; /* NULL if skipped */
    sf_status status;
    int bad_pose, rotated, undistorted;
    char fault[SF_PICTURE_FAULT_BYTES];
} result;

typedef struct loading {
    sf_context *ctx;
    const sf_project *project;
    const sf_load_options *options;
    result *results; /* one an entry */
} loading;

static sf_status make_view(const loading *l, const sf_entry *e, sf_picture *p, result *r) {
    sf_lens lens = scaled_lens(e, p);
    sf_camera camera = pinhole(e, &lens, p);
    if (!sf_lens_is_valid(&lens) || sf_camera_check(&camera)) {
        r->bad_pose = 1;
        return SF_OK;
    }
    int factor = l->options->downscale;
    if (p->width < factor || p->height < factor) {
        snprintf(r->fault, sizeof r->fault, "downscale: %d leaves nothing of %d x %d", factor, p->width,
                 p->height);
        return SF_ERR_ARGUMENT;
    }
    r->undistorted = sf_lens_is_distorted(&lens);
    sf_status status = r->undistorted ? sf_undistort(l->ctx, &lens, p) : SF_OK;
    if (status) return status;
    camera = sf_camera_downscaled(&camera, factor);
    status = sf_view_create(l->ctx, e->name, &camera, e->split, p->weight != NULL, &r->view);
    if (!status) fill_view(p, factor, r->view);
    return status;
}

static void load_entry(void *arg, size_t task, int thread) {
    const loading *l = arg;
    const sf_entry *e = &l->project->entries[task];
    result *r = &l->results[task];
    (void)thread;
    r->bad_pose = e->bad_pose;
    if (r->bad_pose) return;
    sf_picture p;
    r->status = sf_picture_load(l->ctx, e->path, &p);
    if (!r->status && e->mask) r->status = apply_mask(l->ctx, e->mask, &p);
    memcpy(r->fault, p.fault, sizeof r->fault);
    r->rotated = !r->status && p.orientation != 1;
    if (!r->status) r->status = make_view(l, e, &p, r);
    sf_picture_free(l->ctx, &p);
}

/* The scene from what was loaded. */

static sf_status take_result(const loading *l, size_t i, sf_scene *scene) {
    result *r = &l->results[i];
    if (r->bad_pose) {
        scene->skipped_pose++;
    } else if (r->status) {
        if (scene->skipped_missing++ < NAMES_IN_LOG)
            sf_log(l->ctx, SF_LOG_WARNING, "%s: skipped: %s", l->project->entries[i].path, r->fault);
    } else {
        scene->undistorted_views += (size_t)r->undistorted;
        sf_view *view = r->view;
        r->view = NULL;
        return sf_scene_take_view(scene, view);
    }
    return SF_OK;
}

/* What ends the whole, whatever became of other pictures; said again, since those may have failed later. */
static sf_status fatal_result(const loading *l) {
    for (size_t i = 0; i < l->project->count; i++) {
        const char *path = l->project->entries[i].path;
        sf_status status = l->results[i].status;
        if (status == SF_ERR_MEMORY) return sf_fail(l->ctx, status, "%s: out of memory", path);
        if (status == SF_ERR_ARGUMENT) return sf_fail(l->ctx, status, "%s: %s", path, l->results[i].fault);
    }
    return SF_OK;
}

static const char *first_bad_pose(const loading *l) {
    for (size_t i = 0; i < l->project->count; i++)
        if (l->results[i].bad_pose) return l->project->entries[i].path;
    return "";
}

static void report(const loading *l, const char *path, const sf_scene *scene) {
    size_t rotated = 0;
    for (size_t i = 0; i < l->project->count; i++) rotated += (size_t)l->results[i].rotated;
    if (rotated)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: %zu pictures carry an EXIF orientation: it is ignored, as poses assume", path, rotated);
    if (scene->skipped_missing)
        sf_log(l->ctx, SF_LOG_WARNING, "%s: %zu of %zu pictures skipped: missing or not decodable", path,
               scene->skipped_missing, l->project->count);
    if (scene->skipped_pose)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: %zu of %zu views skipped: pose or intrinsics not usable (first: %s)", path,
               scene->skipped_pose, l->project->count, first_bad_pose(l));
    if (scene->skipped_points)
        sf_log(l->ctx, SF_LOG_WARNING, "%s: skipped %zu of %zu points that are not finite (first: #%zu)",
               path, scene->skipped_points, scene->skipped_points + scene->point_count,
               scene->first_skipped_point);
    if (scene->undistorted_views)
        sf_log(l->ctx, SF_LOG_INFO, "%s: %zu views undistorted", path, scene->undistorted_views);
}

static sf_status check_training(const sf_project *p, const char *path, const sf_scene *scene) {
    for (size_t i = 0; i < scene->view_count; i++)
        if (scene->views[i]->split == SF_SPLIT_TRAIN) return SF_OK;
    return sf_fail(
        p->ctx, SF_ERR_EMPTY,
        "%s: no training view is left: of %zu views %zu lack a readable picture, %zu a usable pose, "
        "%zu are held out",
        path, p->count, scene->skipped_missing, scene->skipped_pose, scene->view_count);
}

/* The pictures' size together and of the largest, px: as the cameras have them, or as the files do. */
static double count_pixels(const loading *l, int of_files, double *largest) {
    double sum = 0;
    *largest = 0;
    for (size_t i = 0; i < l->project->count; i++) {
        const sf_entry *e = &l->project->entries[i];
        int width = e->width, height = e->height;
        if (e->bad_pose || (of_files && sf_picture_size(l->ctx, e->path, &width, &height))) continue;
        sum += (double)width * height;
        if ((double)width * height > *largest) *largest = (double)width * height;
    }
    return sum;
}

/* What is kept, and what each thread holds of a picture while it is decoded: pixels of 4 bytes, planes, and
 * planes once more where they are resampled. */
static double bytes_of_pictures(const loading *l, int of_files) {
    enum { KEPT = 3, AT_WORK = 4 + 3 + 3 };
    double largest, factor = l->options->downscale, sum = count_pixels(l, of_files, &largest);
    return KEPT * sum / (factor * factor) + AT_WORK * largest * sf_pool_threads(l->ctx->pool);
}

/* Pictures that the memory cannot hold are refused before one is read. */
static sf_status check_memory(const loading *l, const char *path) {
    const double mega = 1048576;
    double budget = (double)sf_memory_budget((uint64_t)l->options->memory),
           before = (double)sf_memory_resident();
    /* the files' own sizes, which may be smaller, are looked up only where they matter */
    if (!(budget > 0) || before + bytes_of_pictures(l, 0) <= budget) return SF_OK;
    double bytes = bytes_of_pictures(l, 1);
    if (before + bytes <= budget) return SF_OK;
    return sf_fail(
        l->ctx, SF_ERR_MEMORY,
        "%s: memory: %.0f MB are not enough: the pictures take about %.0f MB beside the %.0f in use "
        "(downscale makes them smaller)",
        path, budget / mega, bytes / mega, before / mega);
}

static sf_status fill_scene(const loading *l, const char *path, sf_scene *scene) {
    const sf_project *p = l->project;
    sf_status fits = check_memory(l, path);
    if (fits) return fits;
    sf_pool_run(l->ctx->pool, p->count, load_entry, (void *)l);
    sf_status status = fatal_result(l);
    for (size_t i = 0; !status && i < p->count; i++) status = take_result(l, i, scene);
    if (!status && p->points) status = sf_scene_add_points(scene, p->points, p->xyz, p->rgb);
    if (status) return status;
    report(l, path, scene);
    return check_training(p, path, scene);
}

static sf_status build_scene(const sf_project *p, const char *path, const sf_load_options *options,
                             sf_scene **scene) {
    loading l = {.ctx = p->ctx, .project = p, .options = options};
    l.results = sf_calloc(p->ctx, p->count, sizeof *l.results);
    if (!l.results) return SF_ERR_MEMORY;
    sf_status status = sf_scene_create(p->ctx, scene);
    if (!status) {
        status = fill_scene(&l, path, *scene);
        if (status) sf_scene_destroy(scene);
    }
    for (size_t i = 0; i < p->count; i++)
        if (l.results[i].view) sf_view_release(l.results[i].view);
    sf_free(p->ctx, l.results);
    return status;
}

/* Which kind of project. */

static sf_status read_folder(sf_project *p, const char *path, const sf_load_options *options) {
    char *model;
    sf_status status = sf_colmap_find(p->ctx, path, &model);
    if (status) return status;
    if (model) {
        if (sf_holds_file(path, "transforms.json"))
            sf_log(p->ctx, SF_LOG_INFO, "%s: COLMAP's model is taken, transforms.json is not read", path);
        status = sf_colmap_read(p, path, model, options);
    } else if (sf_holds_file(path, "transforms.json")) {
        char *file = sf_path_join(p->ctx, path, "transforms.json");
        status = file ? sf_transforms_read(p, file) : SF_ERR_MEMORY;
        sf_free(p->ctx, file);
    } else if (sf_holds_file(path, "transforms_train.json")) {
        status = sf_transforms_read_pair(p, path);
    } else {
        status = sf_fail(p->ctx, SF_ERR_IO,
                         "%s: no project: looked for cameras.bin or .txt in sparse/0, sparse and here, for "
                         "transforms.json and transforms_train.json",
                         path);
    }
    sf_free(p->ctx, model);
    return status;
}

static sf_status read_project(sf_project *p, const char *path, const sf_load_options *options) {
    struct stat st;
    if (stat(path, &st)) return sf_fail(p->ctx, SF_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    if (S_ISDIR(st.st_mode)) return read_folder(p, path, options);
    const char *dot = strrchr(path, '.');
    if (S_ISREG(st.st_mode) && dot && !strcmp(dot, ".json")) return sf_transforms_read(p, path);
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: is neither a folder nor a .json file", path);
}

static sf_status load_project(sf_project *p, const char *path, const sf_load_options *options,
                              sf_scene **scene) {
    sf_status status = read_project(p, path, options);
    if (status) return status;
    if (!p->count) return sf_fail(p->ctx, SF_ERR_EMPTY, "%s: the project names no picture", path);
    if (options->max_views && p->count > (size_t)options->max_views)
        return sf_fail(p->ctx, SF_ERR_ARGUMENT, "%s: max_views: %zu views are more than %d", path, p->count,
                       options->max_views);
    status = sf_project_sort(p, path);
    if (!status) status = choose_splits(p, options);
    return status ? status : build_scene(p, path, options, scene);
}

static sf_status check_options(sf_context *ctx, const sf_load_options *options) {
    if (options->downscale < 1 || options->downscale > MAX_DOWNSCALE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "downscale: %d is not in 1..%d", options->downscale,
                       MAX_DOWNSCALE);
    if (options->hold_out < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "hold_out: %d is below 0", options->hold_out);
    if (options->memory < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "memory: %lld is below 0", (long long)options->memory);
    if (options->max_views < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "max_views: %d is below 0", options->max_views);
    return SF_OK;
}

sf_status sf_project_load(sf_context *ctx, const char *path, const sf_load_options *options,
                          sf_scene **scene) {
    *scene = NULL;
    sf_load_options defaults = sf_load_options_default();
    if (!options) options = &defaults;
    sf_status status = check_options(ctx, options);
    if (status) return status;
    sf_project project = {.ctx = ctx};
    status = load_project(&project, path, options, scene);
    free_project(&project);
    return status;
}

/* One picture of the caller's. */

static sf_status add_picture(sf_scene *scene, const char *name, const sf_camera *camera, sf_split split,
                             const sf_picture *p, uint32_t *id) {
    sf_camera scaled = *camera;
    double x = (double)p->width / camera->width, y = (double)p->height / camera->height;
    scaled.width = p->width;
    scaled.height = p->height;
    scaled.fx *= x;
    scaled.cx *= x;
    scaled.fy *= y;
    scaled.cy *= y;
    sf_view *view;
    sf_status status = sf_view_create(scene->ctx, name, &scaled, split, p->weight != NULL, &view);
    if (status) return status;
    fill_view(p, 1, view);
    sf_view_retain(view); /* another thread may take it out of the scene at once */
    status = sf_scene_take_view(scene, view);
    if (!status && id) *id = view->id;
    sf_view_release(view);
    return status;
}

sf_status sf_scene_add_file(sf_scene *scene, const char *path, const sf_camera *camera, sf_split split,
                            uint32_t *id) {
    if (sf_camera_check(camera))
        return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "%s: camera: size, focal length or pose out of range",
                       path);
    sf_picture p;
    sf_status status = sf_picture_load(scene->ctx, path, &p);
    if (status) return status;
    const char *slash = strrchr(path, '/');
    status = add_picture(scene, slash ? slash + 1 : path, camera, split, &p, id);
    sf_picture_free(scene->ctx, &p);
    return status;
}
