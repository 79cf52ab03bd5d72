/* scene.h - the inside of sf_scene: views that are shared and never change, and sparse points. */
#ifndef SF_SCENE_SCENE_H
#define SF_SCENE_SCENE_H

#include <pthread.h>
#include <stdatomic.h>

#include "../base/context.h"
#include "pixel_cache.h"

#include <splatfit/scene.h>

/* The lens that took a picture, before the picture was rectified. */
typedef struct sf_lens_note {
    const char *model; /* static; NULL: not known */
    double seen, kept; /* degrees across: by the lens, by the pinhole camera */
    int undistorted;
} sf_lens_note;

/* A picture and its camera; const once it is in a scene. Reference-counted: a training step holds a reference
 * to its view, so that another thread can remove the view from the scene meanwhile. */
typedef struct sf_view {
    sf_context *ctx;
    atomic_int references;
    uint32_t id;
    sf_split split;
    sf_camera camera;
    char *name;
    char *file; /* path of the picture; NULL: there is none */
    sf_lens_note lens;
    int masked, alpha;          /* whether there was a mask file, an alpha channel */
    uint8_t *rgb;               /* [3][height][width], 8-bit sRGB values, planar */
    uint8_t *weight;            /* [height][width], 255 is full weight; NULL: all have it */
    int has_weight;             /* whether there is a weight, or would be: rgb and weight are NULL in a view
                                   whose pixels are in a file, or were not read (sf_load_options.no_pixels) */
    sf_pixel_cache *cache;      /* the file; NULL: none */
    uint64_t cached_at;         /* the pixels' name there */
    int hidden;                 /* of a view whose pixels are in a file: as sf_view_is_hidden says */
    atomic_uint_least64_t hash; /* of rgb and weight, made when first asked for; 0: not yet */
} sf_view;

struct sf_scene {
    sf_context *ctx;
    pthread_mutex_t lock; /* guards everything below */
    sf_view **views;
    size_t view_count, view_capacity;
    uint32_t next_id;
    float *points;         /* [n][3], world units */
    uint8_t *point_colors; /* [n][3] */
    size_t point_count, point_capacity, color_capacity;
    double origin[3]; /* of the coordinates, in the world */
    const char *kind; /* static; NULL: made by the caller */
    size_t skipped_missing, skipped_pose, skipped_points, undistorted_views, rotated_views;
    size_t first_skipped_point; /* in the order of adding */
};

/* Chooses an origin near the middle `at` of a scene of that size, where it lies so far from 0 that floats
 * there are coarse; returns whether it does. A round one: short, and exactly subtracted. */
int sf_choose_origin(const double at[3], double size, double origin[3]);

/* A view with uninitialised pixels, one reference; the loader fills them in. `weight` only if with_weight. */
sf_status sf_view_create(sf_context *ctx, const char *name, const sf_camera *camera, sf_split split,
                         int with_weight, sf_view **view);
/* The same without pixels. */
sf_status sf_view_create_bare(sf_context *ctx, const char *name, const sf_camera *camera, sf_split split,
                              sf_view **view);
sf_view *sf_view_retain(sf_view *view);
void sf_view_release(sf_view *view);

/* Whether the pixels of a view were not read (sf_load_options.no_pixels). */
int sf_scene_is_unread(sf_scene *scene);
/* Bytes that pixels will take beyond those that they take now: of buffers, and of pictures that were not
 * read, as a load within `budget` (0: not known) would keep them. */
uint64_t sf_scene_missing_bytes(sf_scene *scene, uint64_t budget);

/* Whether no pixel of the view counts: a mask or transparency hides all. */
int sf_view_is_hidden(const sf_view *view);

/* Whether the pinhole picture has lost three degrees or more of the lens's field of view. */
int sf_lens_is_cropped(const sf_lens_note *lens);

/* Passes the caller's reference to the scene; sets view->id. On failure the view is released. */
sf_status sf_scene_take_view(sf_scene *scene, sf_view *view);

/* A new reference to view `id`; NULL: no such view. */
sf_view *sf_scene_retain_id(sf_scene *scene, uint32_t id);

/* As sf_scene_set_pose, with intrinsics for a picture of the same size. */
sf_status sf_scene_set_camera(sf_scene *scene, uint32_t id, const sf_camera *camera);
/* Retains all views, or the training views, in order; sf_scene_release_all releases them, and may be called
 * after a failure, too. */
sf_status sf_scene_retain_all(sf_scene *scene, sf_view ***views, size_t *count);
sf_status sf_scene_retain_training(sf_scene *scene, sf_view ***views, size_t *count);
void sf_scene_release_all(sf_scene *scene, sf_view **views, size_t count);
/* A view whose camera lies far from all others. */
typedef struct sf_far_view {
    uint32_t id;
    const char *name; /* of the view, which the caller keeps in the scene */
    double times;     /* distance from the median centre of the training cameras, in their median distance */
    size_t points;    /* how many of the scene's points are in its picture, out of at most 1,024 */
} sf_far_view;

/* size.c: lists up to `most` views of a split (of both: -1) whose distance from the training cameras' median
 * centre is at least 5 times the median distance; returns how many there are. */
size_t sf_scene_far_views(sf_scene *scene, int split, sf_far_view *list, size_t most);

/* How many points are more than 100 times as far from the training cameras' median centre as they usually
 * are. */
size_t sf_scene_count_far_points(sf_scene *scene);

/* Whether all training cameras are in one place, up to rounding. */
int sf_scene_in_one_place(sf_scene *scene);
/* fingerprint.c: the hash of a view's picture and weights. Errors as sf_view_open. */
sf_status sf_view_hash(sf_view *view, uint64_t *hash);
/* The ids of the training views, in order; *ids is sf_free'd by the caller. */
sf_status sf_scene_training_ids(sf_scene *scene, uint32_t **ids, size_t *count);

#endif
