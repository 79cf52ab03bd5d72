/* colmap.c - see colmap.h. */
#include "colmap.h"

#include <limits.h>
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"
#include "around.h"
#include "colmap_binary.h"
#include "colmap_files.h"
#include "colmap_records.h"
#include "colmap_text.h"
#include "paths.h"
#include "ply.h"

/* A file of either kind. */

typedef struct file_kind {
    const sf_colmap_names *names;
    sf_status (*read)(sf_colmap_reader *r, sf_bytes *b);
    sf_status (*parse)(sf_colmap_reader *r, char *data);
} file_kind;

static const file_kind cameras_file = {&sf_colmap_cameras, sf_colmap_read_cameras, sf_colmap_parse_cameras};
static const file_kind images_file = {&sf_colmap_images, sf_colmap_read_images, sf_colmap_parse_images};
static const file_kind points_file = {&sf_colmap_points, sf_colmap_read_points, sf_colmap_parse_points};

/* Numbers have a point in every locale of the program. */
static sf_status parse_file(sf_colmap_reader *r, const file_kind *kind, uint8_t *data, size_t size) {
    if (memchr(data, 0, size))
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: holds a zero byte: is not text", r->file);
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) return sf_fail(r->ctx, SF_ERR_MEMORY, "%s: out of memory", r->file);
    locale_t before = uselocale(plain);
    sf_status status = kind->parse(r, (char *)data);
    uselocale(before);
    freelocale(plain);
    return status;
}

static sf_status read_one(sf_colmap_reader *r, const file_kind *kind) {
    uint8_t *data;
    size_t size;
    sf_status status = (sf_colmap_is_text(r->file) ? sf_read_text : sf_read_file)(
        r->ctx, r->file, SF_COLMAP_MAX_BYTES, &data, &size);
    if (status) return status;
    sf_bytes b = {.data = data, .size = size};
    status = sf_colmap_is_text(r->file) ? parse_file(r, kind, data, size) : kind->read(r, &b);
    sf_free(r->ctx, data);
    return status;
}

/* `check` (may be NULL) runs over all that was read while the file's name still stands. */
static sf_status read_file(sf_colmap_reader *r, const file_kind *kind,
                           sf_status (*check)(sf_colmap_reader *r)) {
    const char *name = sf_colmap_file_in(r->model, kind->names);
    if (!name)
        return sf_fail(r->ctx, SF_ERR_IO, "%s: holds neither %s nor %s", r->model, kind->names->binary,
                       kind->names->text);
    r->file = sf_path_join(r->ctx, r->model, name);
    if (!r->file) return SF_ERR_MEMORY;
    sf_status status = read_one(r, kind);
    if (!status && check) status = check(r);
    sf_free(r->ctx, r->file);
    r->file = NULL;
    return status;
}

/* Other programs write COLMAP's cameras with their own points. */
static sf_status read_cloud(sf_colmap_reader *r) {
    static const char name[] = "points3D.ply";
    sf_project *p = r->project;
    if (!sf_holds_file(r->model, name)) {
        sf_log(r->ctx, SF_LOG_WARNING,
               "%s: no points3D.bin, points3D.txt or points3D.ply: the scene has no points", r->model);
        return SF_OK;
    }
    char *path = sf_path_join(r->ctx, r->model, name);
    sf_status status = path ? sf_ply_read_points(r->ctx, path, &p->xyz, &p->rgb, &p->points) : SF_ERR_MEMORY;
    sf_free(r->ctx, path);
    return status;
}

static sf_status read_all(sf_colmap_reader *r) {
    sf_status status = read_file(r, &cameras_file, sf_colmap_sort_cameras);
    if (!status) status = read_file(r, &images_file, sf_colmap_check_image_ids);
    if (status) return status;
    if (sf_colmap_file_in(r->model, &sf_colmap_points)) return read_file(r, &points_file, NULL);
    return read_cloud(r);
}

/* A file of cameras alone. */

static sf_status take_one_camera(sf_colmap_reader *r, sf_calibration *to) {
    if (!r->camera_count) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: holds no camera", r->file);
    const sf_colmap_camera *first = r->cameras;
    if (!first->supported) return sf_colmap_unsupported(r, first);
    if (!sf_optics_to_lens(&first->lens, &to->lens))
        return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: camera %lu: model %s is not supported here", r->file,
                       (unsigned long)first->id, first->lens.model);
    for (size_t i = 1; i < r->camera_count; i++) {
        const sf_colmap_camera *c = &r->cameras[i];
        if (c->width != first->width || c->height != first->height ||
            memcmp(&c->lens, &first->lens, sizeof c->lens))
            return sf_fail(r->ctx, SF_ERR_UNSUPPORTED,
                           "%s: holds %zu cameras that differ: one alone can be taken", r->file,
                           r->camera_count);
    }
    to->width = first->width;
    to->height = first->height;
    return SF_OK;
}

sf_status sf_colmap_read_camera(sf_context *ctx, const char *file, int binary, uint8_t *data, size_t size,
                                sf_calibration *camera) {
    sf_colmap_reader r = {.ctx = ctx};
    sf_bytes b = {.data = data, .size = size};
    r.file = sf_text_copy(ctx, file);
    if (!r.file) return SF_ERR_MEMORY;
    sf_status status = binary ? sf_colmap_read_cameras(&r, &b) : parse_file(&r, &cameras_file, data, size);
    if (!status) status = sf_colmap_sort_cameras(&r);
    if (!status) status = take_one_camera(&r, camera);
    sf_free(ctx, r.cameras);
    sf_free(ctx, r.file);
    return status;
}

/* The folder of the pictures. */

/* The first of the usual folders in `path`; *pictures NULL: there is none. */
static sf_status look_for_pictures(sf_context *ctx, const char *path, const char *wanted, char **pictures) {
    for (size_t i = 0; i < (wanted ? 1 : SF_IMAGE_FOLDERS); i++) {
        const char *name = wanted ? wanted : sf_image_folders[i];
        *pictures = sf_path_join(ctx, path, name);
        if (!*pictures) return SF_ERR_MEMORY;
        if (sf_is_folder(*pictures)) {
            if (i) sf_tell_images(ctx, path, name);
            return SF_OK;
        }
        sf_status status = sf_check_link(ctx, *pictures);
        sf_free(ctx, *pictures);
        *pictures = NULL;
        if (status) return status;
    }
    return SF_OK;
}

/* As COLMAP's automatic_reconstructor leaves it in dense/0. */
static int is_whole(const char *folder) {
    return sf_holds_project(folder) && sf_holds_folder(folder, "images");
}

/* Names the folder that the user may have meant: a whole project further down, or pictures under another
 * name. */
static sf_status no_pictures(sf_context *ctx, const char *path) {
    static const char none[] = "no folder of pictures: looked for images, images_2, images_4, images_8";
    static const char *const beside[] = {"../images", "../input"};
    char name[PATH_MAX];
    if (sf_find_folder(path, is_whole, name))
        return sf_fail(ctx, SF_ERR_IO, "%s: %s; the project in '%s/%s' has one: give that instead", path,
                       none, path, name);
    if (sf_find_folder(path, sf_holds_pictures, name))
        return sf_fail(ctx, SF_ERR_IO, "%s: %s; if it is '%s', add --images '%s'", path, none, name, name);
    for (size_t i = 0; i < sizeof beside / sizeof *beside; i++) /* ns-process-data's and INRIA's */
        if (sf_holds_folder(path, beside[i]))
            return sf_fail(ctx, SF_ERR_IO, "%s: %s; if it is '%s', add --images '%s'", path, none, beside[i],
                           beside[i]);
    return sf_fail(ctx, SF_ERR_IO, "%s: %s; --images NAME names another", path, none);
}

/* COLMAP may have been told of the project's folder as that of the pictures: names begin with images/ then.
 */
static sf_status start_names_above(sf_project *p, const char *above) {
    size_t found = 0;
    for (size_t i = 0; i < p->count; i++)
        if (sf_is_file(p->entries[i].path)) return SF_OK;
    for (size_t i = 0; i < p->count; i++) found += sf_holds_file(above, p->entries[i].name) != 0;
    if (!found) return SF_OK;
    sf_log(p->ctx, SF_LOG_INFO, "%s: names of pictures begin in it, not in its folder images", above);
    for (size_t i = 0; i < p->count; i++) {
        sf_entry *e = &p->entries[i];
        char *path = sf_path_join(p->ctx, above, e->name);
        if (!path) return SF_ERR_MEMORY;
        sf_free(p->ctx, e->path);
        e->path = path;
    }
    return SF_OK;
}

static int holds_any(const sf_project *p) {
    for (size_t i = 0; i < p->count; i++)
        if (sf_is_file(p->entries[i].path)) return 1;
    return !p->count;
}

/* The path may be that of the model itself, sparse/0: its project is above then. Otherwise *beside: pictures
 * are looked for in the model's folder, where RealityScan writes them. */
static sf_status find_pictures(sf_project *p, const char *path, const char *wanted, char **pictures,
                               int *beside) {
    static const char *const folders[] = {".", "..", "../.."};
    for (size_t i = 0; i < (sf_colmap_holds_model(path) ? 3 : 1); i++) {
        char *folder = i ? sf_path_join(p->ctx, path, folders[i]) : sf_text_copy(p->ctx, path);
        if (!folder) return SF_ERR_MEMORY;
        sf_status status = look_for_pictures(p->ctx, folder, wanted, pictures);
        if (!status && *pictures) status = sf_project_set_folder(p, folder);
        sf_free(p->ctx, folder);
        if (status || *pictures) return status;
    }
    if (wanted) return sf_fail(p->ctx, SF_ERR_IO, "%s/%s: no such folder of pictures", path, wanted);
    if (!sf_colmap_holds_model(path)) return no_pictures(p->ctx, path);
    *beside = 1;
    *pictures = sf_text_copy(p->ctx, path);
    return *pictures ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_colmap_read(sf_project *project, const char *path, const char *model,
                         const sf_load_options *options) {
    char *pictures = NULL;
    project->kind = "COLMAP";
    int beside = 0;
    sf_status status = find_pictures(project, path, options->images, &pictures, &beside);
    if (status) {
        sf_free(project->ctx, pictures);
        return status;
    }
    sf_colmap_reader r = {.ctx = project->ctx, .project = project, .model = model, .pictures = pictures};
    status = read_all(&r);
    if (!status && !beside && !options->images) status = start_names_above(project, project->folder);
    if (!status && beside && !holds_any(project)) status = no_pictures(project->ctx, path);
    sf_free(r.ctx, r.cameras);
    sf_free(r.ctx, r.image_ids);
    sf_free(r.ctx, pictures);
    return status;
}
