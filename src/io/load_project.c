/* load_project.c - which kind of project a path holds, and how it becomes a scene. */
#include "load_project.h"

#include "around.h"
#include "colmap.h"
#include "copies.h"
#include "mask.h"
#include "near_names.h"
#include "no_project.h"
#include "opensfm.h"
#include "origin.h"
#include "paths.h"
#include "polycam.h"
#include "transforms.h"
#include "views.h"
#include "zip.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum { MAX_DOWNSCALE = 64, MOST_AROUND = 8 /* folders around the project of an archive */ };

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
    } else if (sf_polycam_is(path)) {
        status = sf_polycam_read(p, path, options);
    } else {
        status = sf_no_project_in(p->ctx, path);
    }
    sf_free(p->ctx, model);
    return status;
}

/* Blender's file of training views stands for its folder: the held-out views are in another file. */
static sf_status read_pair_of(sf_project *p, const char *path, const sf_load_options *options) {
    char *folder = sf_path_folder(p->ctx, path);
    sf_status status = folder ? sf_transforms_read_pair(p, folder, options) : SF_ERR_MEMORY;
    sf_free(p->ctx, folder);
    return status;
}

/* By its content: transforms have an object, OpenSfM has an array. */
static sf_status read_json(sf_project *p, const char *path, const sf_load_options *options) {
    const char *slash = strrchr(path, '/');
    if (sf_opensfm_is(path)) return sf_opensfm_read(p, path, options);
    if (!strcmp(slash ? slash + 1 : path, "transforms_train.json")) return read_pair_of(p, path, options);
    return sf_transforms_read(p, path, options);
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
    if (!status) status = sf_project_take_near(p);
    if (!status) status = sf_project_move_origin(p);
    if (!status) status = choose_splits(p, options);
    if (!status) status = sf_warn_of_copies(p);
    if (!status) status = sf_masks_find(p, options);
    return status ? status : sf_project_build(p, options, scene);
}

/* In an archive. */

/* The name of the only entry of a folder; 0: the folder is empty or has more entries. */
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

/* The project of an archive that holds other things beside it. */
static sf_status load_beside(sf_project *p, const char *top, const sf_load_options *options,
                             sf_scene **scene) {
    char name[PATH_MAX];
    if (sf_holds_project(top) || !sf_find_folder(top, sf_holds_project, name))
        return load_from(p, top, options, scene);
    char *inside = sf_path_join(p->ctx, top, name);
    sf_status status = inside ? load_from(p, inside, options, scene) : SF_ERR_MEMORY;
    sf_free(p->ctx, inside);
    return status;
}

/* Archives often hold the project's folder, not what is in it: the project in `top`, at most MOST_AROUND
 * folders down. */
static sf_status load_inside(sf_project *p, const char *top, int depth, const sf_load_options *options,
                             sf_scene **scene) {
    char name[NAME_MAX + 1];
    if (depth == MOST_AROUND || sf_holds_project(top) || !only_entry(top, name))
        return load_beside(p, top, options, scene);
    char *inside = sf_path_join(p->ctx, top, name);
    sf_status status = SF_ERR_MEMORY;
    if (inside)
        status = sf_is_folder(inside) ? load_inside(p, inside, depth + 1, options, scene)
                                      : load_beside(p, top, options, scene);
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

sf_load_options sf_load_options_default(void) {
    return (sf_load_options){.downscale = 1, .hold_out = 8, .sub_model = -1};
}

void sf_scene_cancel_loads(sf_context *ctx) { atomic_store(&ctx->loads_cancelled, 1); }

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
