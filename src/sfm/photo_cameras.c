/* photo_cameras.c - see photo_cameras.h. */
#include "photo_cameras.h"

#include <string.h>

#include "../io/paths.h"
#include "exif.h"

/* A focal length that nothing tells, in the longer side of the photo. */
#define GUESS 1.2

/* The focal length that a file tells is rounded, and the lens breathes as it focuses. */
#define TOLD_SIGMA 0.05

typedef struct grouping {
    sf_reconstruction *r;
    const sf_sfm_options *options;
    sf_exif *of;         /* [cameras]: of the first photo, */
    const char **folder; /* [cameras]: and its name, which begins with its folder */
} grouping;

/* The lens to begin with. */
static sf_map_camera first_camera(const grouping *g, const sf_photo_file *photo, const sf_exif *exif) {
    const sf_sfm_options *o = g->options;
    double longer = photo->width > photo->height ? photo->width : photo->height,
           told = sf_exif_focal(exif, photo->width, photo->height), prior = o->focal > 0 ? o->focal : told,
           focal = prior > 0 ? prior : GUESS * longer;
    sf_map_camera camera = {
        .unit = photo->factor,
        .width = photo->width,
        .height = photo->height,
        .lens = {.fx = focal, .fy = focal, .cx = photo->width / 2.0, .cy = photo->height / 2.0},
        .focal_prior = prior,
        .focal_sigma = TOLD_SIGMA,
        .is_doubtful = !(o->focal > 0) && told > 0,
        .focal_told = told};
    if (o->lens) camera.lens = *o->lens, camera.is_fixed = 1;
    return camera;
}

static int are_of_one_folder(const char *a, const char *b) {
    const char *end = strrchr(a, '/'), *other = strrchr(b, '/');
    size_t length = end ? (size_t)(end - a) : 0;
    return length == (other ? (size_t)(other - b) : 0) && !strncmp(a, b, length);
}

/* Of photos that do not name their camera, each folder's are of one. */
static int may_share(const grouping *g, size_t camera, const sf_photo_file *photo, const sf_exif *exif) {
    return sf_exif_is_same(&g->of[camera], exif) && (g->options->lens || *exif->make || *exif->model ||
                                                     are_of_one_folder(g->folder[camera], photo->name));
}

/* The camera of a photo; camera_count: a new one. */
static size_t find_camera(const grouping *g, const sf_photo_file *photo, const sf_exif *exif,
                          uint8_t *turned) {
    const sf_reconstruction *r = g->r;
    for (size_t c = 0; c < r->camera_count; c++) {
        const sf_map_camera *camera = &r->cameras[c];
        int is_same = camera->width == photo->width && camera->height == photo->height,
            is_turned = camera->width == photo->height && camera->height == photo->width && !camera->is_fixed;
        *turned = (uint8_t)!is_same;
        if ((is_same || is_turned) && may_share(g, c, photo, exif)) return c;
    }
    *turned = 0;
    return r->camera_count;
}

static sf_status add_photo(const grouping *g, size_t i, const char *folder) {
    sf_reconstruction *r = g->r;
    const sf_photo_file *photo = &r->list.photos[i];
    sf_exif exif = {.make = ""};
    if (!g->options->lens) {
        char *path = sf_path_join(r->ctx, folder, photo->name);
        if (!path) return SF_ERR_MEMORY;
        sf_exif_read(path, &exif);
        sf_free(r->ctx, path);
    }
    size_t c = find_camera(g, photo, &exif, &r->is_turned[i]);
    if (c == r->camera_count) {
        r->cameras[r->camera_count++] = first_camera(g, photo, &exif);
        g->of[c] = exif, g->folder[c] = photo->name;
    }
    r->camera_of[i] = (uint32_t)c;
    return SF_OK;
}

/* A lens is for pictures of its size: others show another part of what it sees, or on fewer pixels. */
static sf_status check_size(const grouping *g, const sf_photo_file *photo, const char *folder) {
    const sf_sfm_options *o = g->options;
    int32_t width = o->lens_width, height = o->lens_height;
    if (!o->lens) return SF_OK;
    if (!width && g->r->camera_count) width = g->r->cameras[0].width, height = g->r->cameras[0].height;
    if (!width || (photo->width == width && photo->height == height)) return SF_OK;
    return sf_fail(
        g->r->ctx, SF_ERR_ARGUMENT,
        "%s/%s: size: %d x %d is not the lens's %d x %d: take it out of the folder, or give no lens", folder,
        photo->name, photo->width, photo->height, (int)width, (int)height);
}

static sf_status add_photos(const grouping *g, const char *folder) {
    sf_reconstruction *r = g->r;
    sf_status status = SF_OK;
    for (size_t i = 0; i < r->list.count && !status; i++) {
        if (*r->list.photos[i].fault) continue;
        status = check_size(g, &r->list.photos[i], folder);
        if (!status) status = add_photo(g, i, folder);
    }
    if (status || r->camera_count) return status;
    return sf_fail(r->ctx, SF_ERR_EMPTY, "no photo can be read (first: %s: %s)", r->list.photos[0].name,
                   r->list.photos[0].fault);
}

sf_status sf_photo_cameras(sf_reconstruction *r, const char *folder, const sf_sfm_options *options) {
    size_t count = r->list.count + 1;
    grouping g = {r, options, sf_alloc(r->ctx, count, sizeof *g.of),
                  sf_alloc(r->ctx, count, sizeof *g.folder)};
    r->cameras = sf_alloc(r->ctx, count, sizeof *r->cameras);
    r->camera_of = sf_calloc(r->ctx, count, sizeof *r->camera_of);
    r->is_turned = sf_calloc(r->ctx, count, 1);
    sf_status status = g.of && g.folder && r->cameras && r->camera_of && r->is_turned ? SF_OK : SF_ERR_MEMORY;
    if (!status) status = add_photos(&g, folder);
    sf_free(r->ctx, g.of);
    sf_free(r->ctx, g.folder);
    return status;
}

/* A quarter turn, x' = y, y' = width - x: the middle of the picture stays, and so do focal length and
 * radial distortion. */

void sf_photo_turn(const sf_reconstruction *r, size_t photo, double x, double y, double pixel[2]) {
    int is_turned = r->is_turned[photo];
    pixel[0] = is_turned ? y : x;
    pixel[1] = is_turned ? r->list.photos[photo].width - x : y;
}

sf_rigid sf_photo_pose(const sf_reconstruction *r, size_t photo, const sf_rigid *pose) {
    sf_rigid T = *pose;
    if (!r->is_turned[photo]) return T;
    for (int k = 0; k < 3; k++) T.R[k] = -pose->R[3 + k], T.R[3 + k] = pose->R[k];
    T.t[0] = -pose->t[1], T.t[1] = pose->t[0];
    return T;
}

sf_lens sf_photo_lens(const sf_map_camera *camera, int is_turned) {
    sf_lens lens = camera->lens;
    if (is_turned) lens.cx = camera->lens.cy, lens.cy = camera->lens.cx;
    return lens;
}
