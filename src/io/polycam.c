/* polycam.c - see polycam.h.
 *
 * A camera's file has the name of its picture, a time in microseconds, and holds fx, fy, cx, cy, width and
 * height in pixels and t_00 to t_23, the first three rows of the matrix from the camera to the world:
 * ARKit's, in metres, y up, the camera's axes OpenGL's. Pictures are in landscape, as the sensor has them,
 * whichever way the phone was held. The corrected ones are undistorted, and their cameras are those that the
 * app optimised together: poses of both kinds do not mix.
 */
#include "polycam.h"

#include "json_read.h"
#include "paths.h"
#include "transforms.h"

#include <dirent.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const uint64_t MAX_FILE_BYTES = 1 << 20;
/* Undistortion leaves black along the sides of a corrected picture: nerfstudio crops as much. */
enum { BLACK_BORDER_PX = 15 };

static const struct kind {
    const char *cameras, *images;
} corrected = {"keyframes/corrected_cameras", "keyframes/corrected_images"},
  raw = {"keyframes/cameras", "keyframes/images"},
  within = {"corrected_cameras", "corrected_images"}; /* of keyframes/ itself */

typedef struct reader {
    sf_project *project;
    char *cameras, *images; /* folders */
    int border_px;
} reader;

int sf_polycam_is(const char *folder) {
    return sf_holds_folder(folder, corrected.cameras) || sf_holds_folder(folder, raw.cameras) ||
           sf_holds_folder(folder, within.cameras);
}

static sf_status get_number(const reader *r, const char *file, const json_t *root, const char *key,
                            double *value) {
    const json_t *number = json_object_get(root, key);
    *value = json_number_value(number);
    if (json_is_number(number)) return SF_OK;
    return sf_fail(r->project->ctx, SF_ERR_FORMAT, "%s: %s: %s", file, key,
                   number ? "is not a number" : "is missing");
}

static sf_status get_side(const reader *r, const char *file, const json_t *root, const char *key, int *side) {
    double value;
    sf_status status = get_number(r, file, root, key, &value);
    if (status) return status;
    if (!(value >= 1 && value <= SF_PICTURE_MAX_SIDE && value == floor(value)))
        return sf_fail(r->project->ctx, SF_ERR_FORMAT, "%s: %s: %g is not a whole number in 1..%d", file, key,
                       value, SF_PICTURE_MAX_SIDE);
    *side = (int)value;
    return SF_OK;
}

static sf_status fill_in(const reader *r, const char *file, const json_t *root, sf_entry *e) {
    double c2w[16] = {[15] = 1};
    e->lens = (sf_optics){.model = "PINHOLE", .projection = SF_PERSPECTIVE};
    e->border_px = r->border_px;
    sf_status status = get_side(r, file, root, "width", &e->width);
    if (!status) status = get_side(r, file, root, "height", &e->height);
    if (!status) status = get_number(r, file, root, "fx", &e->lens.fx);
    if (!status) status = get_number(r, file, root, "fy", &e->lens.fy);
    if (!status) status = get_number(r, file, root, "cx", &e->lens.cx);
    if (!status) status = get_number(r, file, root, "cy", &e->lens.cy);
    for (int i = 0; !status && i < 12; i++) {
        char key[] = {'t', '_', (char)('0' + i / 4), (char)('0' + i % 4), 0};
        status = get_number(r, file, root, key, &c2w[i]);
    }
    if (!status) sf_entry_set_opengl_pose(e, c2w);
    return status;
}

/* The camera of a file "TIME.json". */
static sf_status read_camera(const reader *r, const char *name) {
    sf_context *ctx = r->project->ctx;
    char picture[NAME_MAX + sizeof ".jpg"];
    json_t *root = NULL;
    sf_entry *e;
    snprintf(picture, sizeof picture, "%.*s.jpg", (int)(strlen(name) - strlen(".json")), name);
    char *file = sf_path_join(ctx, r->cameras, name);
    sf_status status = file ? sf_json_read(ctx, file, MAX_FILE_BYTES, &root) : SF_ERR_MEMORY;
    if (!status) status = sf_project_add(r->project, file, r->images, picture, &e);
    if (!status) status = fill_in(r, file, root, e);
    json_decref(root);
    sf_free(ctx, file);
    return status;
}

static sf_status read_cameras(const reader *r) {
    DIR *folder = opendir(r->cameras);
    const struct dirent *found;
    sf_status status = SF_OK;
    while (!status && folder && (found = readdir(folder))) {
        const char *dot = strrchr(found->d_name, '.');
        if (dot && dot > found->d_name && found->d_name[0] != '.' && !strcmp(dot, ".json"))
            status = read_camera(r, found->d_name);
    }
    if (folder) closedir(folder);
    return status;
}

/* The user's word goes before what is there; the folder of pictures names the cameras too. */
static sf_status choose(const sf_project *p, const char *folder, const char *wanted,
                        const struct kind **kind) {
    int is_there = sf_holds_folder(folder, corrected.cameras) && sf_holds_folder(folder, corrected.images);
    *kind = is_there ? &corrected : &raw;
    if (sf_holds_folder(folder, within.cameras) && (!wanted || !strcmp(wanted, within.images)))
        *kind = &within;
    else if (wanted && !strcmp(wanted, corrected.images))
        *kind = &corrected;
    else if (wanted && !strcmp(wanted, raw.images))
        *kind = &raw;
    else if (wanted)
        return sf_fail(p->ctx, SF_ERR_ARGUMENT,
                       "%s: images: %s: the pictures of Polycam's export are in %s or %s", folder, wanted,
                       corrected.images, raw.images);
    else if (!is_there)
        sf_log(p->ctx, SF_LOG_WARNING,
               "%s: Polycam's export without corrected pictures and cameras: %s and ARKit's poses are taken, "
               "which are distorted a little, and drift",
               folder, raw.images);
    return SF_OK;
}

sf_status sf_polycam_read(sf_project *project, const char *folder, const sf_load_options *options) {
    sf_context *ctx = project->ctx;
    const struct kind *kind;
    project->kind = "Polycam";
    sf_status status = choose(project, folder, options->images, &kind);
    if (status) return status;
    reader r = {.project = project,
                .cameras = sf_path_join(ctx, folder, kind->cameras),
                .images = sf_path_join(ctx, folder, kind->images),
                .border_px = kind != &raw && !options->no_masks ? BLACK_BORDER_PX : 0};
    if (r.border_px)
        sf_log(ctx, SF_LOG_INFO,
               "%s: %s is taken; %d pixels along each side are ignored, where the correction leaves black "
               "(no_masks, --no-masks uses them)",
               folder, kind->images, r.border_px);
    status = r.cameras && r.images ? read_cameras(&r) : SF_ERR_MEMORY;
    sf_free(ctx, r.cameras);
    sf_free(ctx, r.images);
    return status;
}
