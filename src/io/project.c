/* project.c - see project.h. */
#include "project.h"

#include "../base/file.h"
#include "colmap.h"
#include "mask.h"
#include "no_project.h"
#include "opensfm.h"
#include "transforms.h"
#include "zip.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { MAX_DOWNSCALE = 64, MOST_AROUND = 8 /* folders around the project of an archive */ };

static const uint64_t MAX_LIST_BYTES = 1 << 28;

/* Paths. */

char *sf_text_copy(sf_context *ctx, const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = sf_alloc(ctx, size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

char *sf_path_join(sf_context *ctx, const char *folder, const char *name) {
    int stem = (int)strlen(folder);
    while (stem && folder[stem - 1] == '/') stem--;
    size_t size = (size_t)stem + strlen(name) + 2;
    char *path = sf_alloc(ctx, size, 1);
    if (path) snprintf(path, size, "%.*s/%s", stem, folder, name);
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

void sf_project_free(sf_project *p) {
    for (size_t i = 0; i < p->count; i++) {
        sf_free(p->ctx, p->entries[i].name);
        sf_free(p->ctx, p->entries[i].path);
        sf_free(p->ctx, p->entries[i].mask);
    }
    sf_free(p->ctx, p->entries);
    sf_free(p->ctx, p->xyz);
    sf_free(p->ctx, p->rgb);
    sf_free(p->ctx, p->folder);
}

sf_status sf_project_set_folder(sf_project *p, const char *folder) {
    sf_free(p->ctx, p->folder);
    p->folder = sf_text_copy(p->ctx, folder);
    return p->folder ? SF_OK : SF_ERR_MEMORY;
}

static void turn_slashes(char *name) {
    for (; *name; name++)
        if (*name == '\\') *name = '/';
}

char *sf_plain_name(sf_context *ctx, const char *folder, const char *name) {
    char *plain = sf_text_copy(ctx, name);
    if (plain && strchr(name, '\\') && !sf_holds_file(folder, name)) turn_slashes(plain);
    return plain;
}

static sf_status add_plain(sf_project *p, const char *file, const char *folder, const char *name,
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

sf_status sf_entry_complete(sf_context *ctx, sf_entry *e, const char *const *endings) {
    for (; *endings; endings++) {
        size_t size = strlen(e->path) + strlen(*endings) + 1;
        char *path = sf_alloc(ctx, size, 1);
        if (!path) return SF_ERR_MEMORY;
        snprintf(path, size, "%s%s", e->path, *endings);
        if (sf_is_file(path)) {
            sf_free(ctx, e->path);
            e->path = path;
            return SF_OK;
        }
        sf_free(ctx, path);
    }
    return SF_OK;
}

sf_status sf_project_add(sf_project *p, const char *file, const char *folder, const char *name,
                         sf_entry **entry) {
    char *plain = sf_plain_name(p->ctx, folder, name);
    sf_status status = plain ? add_plain(p, file, folder, plain, entry) : SF_ERR_MEMORY;
    sf_free(p->ctx, plain);
    return status;
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

/* The line with '/' for '\\'. */
static size_t hold_out_plain(char *line, size_t count, const char *const *names, sf_split *splits) {
    if (!strchr(line, '\\')) return 0;
    turn_slashes(line);
    return hold_out_line(without_dot(line), count, names, splits);
}

static sf_status hold_out_lines(sf_context *ctx, const char *path, char *text, size_t count,
                                const char *const *names, sf_split *splits) {
    for (unsigned long number = 1; *text; number++) {
        size_t length = strcspn(text, "\n");
        char *line = text;
        text += length + (text[length] == '\n');
        while (length && strchr(" \t\r", line[length - 1])) length--;
        line[length] = 0;
        if (length && !hold_out_line(without_dot(line), count, names, splits) &&
            !hold_out_plain(line, count, names, splits))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: line %lu: no picture is named '%s'", path, number,
                           line);
    }
    return SF_OK;
}

static sf_status split_by_list(sf_context *ctx, const char *path, size_t count, const char *const *names,
                               sf_split *splits) {
    uint8_t *text;
    size_t size;
    sf_status status = sf_read_text(ctx, path, MAX_LIST_BYTES, &text, &size);
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

/* Which kind of project. */

/* Reads "folder/name" by `read`. */
static sf_status read_in(sf_project *p, const char *folder, const char *name, const sf_load_options *options,
                         sf_status (*read)(sf_project *, const char *, const sf_load_options *)) {
    char *file = sf_path_join(p->ctx, folder, name);
    sf_status status = file ? read(p, file, options) : SF_ERR_MEMORY;
    sf_free(p->ctx, file);
    return status;
}

static sf_status read_folder(sf_project *p, const char *path, const sf_load_options *options) {
    char *model;
    sf_status status = sf_colmap_find(p->ctx, path, options->sub_model, &model);
    if (status) return status;
    if (model) {
        if (sf_holds_file(path, "transforms.json"))
            sf_log(p->ctx, SF_LOG_INFO, "%s: COLMAP's model is taken, transforms.json is not read", path);
        status = sf_colmap_read(p, path, model, options);
    } else if (sf_holds_file(path, "transforms.json")) {
        status = read_in(p, path, "transforms.json", options, sf_transforms_read);
    } else if (sf_holds_file(path, "transforms_train.json")) {
        status = sf_transforms_read_pair(p, path, options);
    } else if (sf_holds_file(path, "reconstruction.json")) {
        status = read_in(p, path, "reconstruction.json", options, sf_opensfm_read);
    } else if (sf_holds_file(path, "opensfm/reconstruction.json")) {
        status = read_in(p, path, "opensfm/reconstruction.json", options, sf_opensfm_read);
    } else {
        status = sf_no_project_in(p->ctx, path);
    }
    sf_free(p->ctx, model);
    return status;
}

/* By its content: transforms have an object, OpenSfM has an array. */
static sf_status read_json(sf_project *p, const char *path, const sf_load_options *options) {
    return sf_opensfm_is(path) ? sf_opensfm_read(p, path, options) : sf_transforms_read(p, path, options);
}

static sf_status read_project(sf_project *p, const char *path, const sf_load_options *options) {
    struct stat st;
    if (stat(path, &st)) return sf_fail(p->ctx, SF_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    sf_status status = sf_project_set_folder(p, path);
    if (status) return status;
    if (S_ISDIR(st.st_mode)) return read_folder(p, path, options);
    const char *dot = strrchr(path, '.');
    if (S_ISREG(st.st_mode) && dot && !strcmp(dot, ".json")) return read_json(p, path, options);
    return sf_no_project_file(p->ctx, path);
}

static sf_status load_from(sf_project *p, const char *path, const sf_load_options *options,
                           sf_scene **scene) {
    sf_status status = read_project(p, path, options);
    if (status) return status;
    if (!p->count) return sf_fail(p->ctx, SF_ERR_EMPTY, "%s: the project names no picture", p->path);
    if (options->max_views && p->count > (size_t)options->max_views)
        return sf_fail(p->ctx, SF_ERR_ARGUMENT, "%s: max_views: %zu views are more than %d", p->path,
                       p->count, options->max_views);
    status = sf_project_sort(p, p->path);
    if (!status) status = choose_splits(p, options);
    if (!status) status = sf_masks_find(p, options);
    return status ? status : sf_project_build(p, options, scene);
}

/* Cancelling. */

void sf_scene_cancel_loads(sf_context *ctx) { atomic_store(&ctx->loads_cancelled, 1); }

sf_status sf_load_cancelled(sf_context *ctx, const char *path) {
    return sf_fail(ctx, SF_ERR_CANCELLED, "%s: reading it was cancelled", path);
}

/* In an archive. */

int sf_holds_project(const char *folder) {
    static const char *const files[] = {"cameras.bin",         "cameras.txt",
                                        "transforms.json",     "transforms_train.json",
                                        "reconstruction.json", "opensfm/reconstruction.json"};
    char sparse[PATH_MAX];
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        if (sf_holds_file(folder, files[i])) return 1;
    int size = snprintf(sparse, sizeof sparse, "%s/sparse", folder);
    return size > 0 && (size_t)size < sizeof sparse && sf_is_folder(sparse);
}

/* The name of the only entry of a folder; 0: there is none, or another. */
static int only_entry(const char *path, char name[NAME_MAX + 1]) {
    DIR *folder = opendir(path);
    const struct dirent *e;
    size_t count = 0;
    while (folder && (e = readdir(folder))) {
        if (!strcmp(e->d_name, ".") || !strcmp(e->d_name, "..")) continue;
        snprintf(name, NAME_MAX + 1, "%s", e->d_name);
        count++;
    }
    if (folder) closedir(folder);
    return count == 1;
}

/* Archives often hold the project's folder, not what is in it: the project in `top`, at most MOST_AROUND
 * folders down. */
static sf_status load_inside(sf_project *p, const char *top, int depth, const sf_load_options *options,
                             sf_scene **scene) {
    char name[NAME_MAX + 1];
    if (depth == MOST_AROUND || sf_holds_project(top) || !only_entry(top, name))
        return load_from(p, top, options, scene);
    char *inside = sf_path_join(p->ctx, top, name);
    sf_status status = SF_ERR_MEMORY;
    if (inside)
        status = sf_is_folder(inside) ? load_inside(p, inside, depth + 1, options, scene)
                                      : load_from(p, top, options, scene);
    sf_free(p->ctx, inside);
    return status;
}

static sf_status load_project(sf_project *p, const char *path, const sf_load_options *options,
                              sf_scene **scene) {
    sf_unpacked to;
    if (!sf_is_file(path) || !sf_zip_is(path)) return load_from(p, path, options, scene);
    sf_status status = sf_zip_unpack(p->ctx, path, &to);
    if (status) return status;
    sf_show_as(p->ctx, to.project, path);
    status = load_inside(p, to.project, 0, options, scene);
    sf_show_as(p->ctx, NULL, NULL);
    sf_zip_remove(p->ctx, &to);
    return status;
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
    if (options->sub_model < -1)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "sub_model: %d is below -1", options->sub_model);
    if ((int)options->alpha < SF_ALPHA_AUTO || options->alpha > SF_ALPHA_IGNORE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "alpha: %d is no sf_alpha", (int)options->alpha);
    for (int c = 0; c < 3; c++)
        if (!(options->background[c] >= 0 && options->background[c] <= 1))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "background: %g is not in 0..1",
                           (double)options->background[c]);
    return SF_OK;
}

sf_status sf_project_load(sf_context *ctx, const char *path, const sf_load_options *options,
                          sf_scene **scene) {
    *scene = NULL;
    sf_load_options defaults = sf_load_options_default();
    if (!options) options = &defaults;
    sf_status status = check_options(ctx, options);
    if (status) return status;
    sf_project project = {.ctx = ctx, .path = path};
    status = load_project(&project, path, options, scene);
    sf_project_free(&project);
    return status;
}
