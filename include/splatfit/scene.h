/* scene.h - what a model is fitted to: views (a picture and its camera) and sparse points.
 *
 * Views may be added and removed from any thread while a fitter works on the scene. Pictures are kept with
 * 8 bits a channel.
 */
#ifndef SPLATFIT_SCENE_H
#define SPLATFIT_SCENE_H

#include <stdint.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pictures with their cameras, and points. */
typedef struct sf_scene sf_scene;

/* What a view is for. */
typedef enum sf_split {
    SF_SPLIT_TRAIN, /* the fit sees it */
    SF_SPLIT_TEST   /* held out: only ever evaluated */
} sf_split;

/* What an alpha channel of a picture means. */
typedef enum sf_alpha {
    SF_ALPHA_AUTO,  /* blend in Blender's transforms_train.json and its like, else mask */
    SF_ALPHA_MASK,  /* what is transparent is ignored: 0 not at all, the largest value in full */
    SF_ALPHA_BLEND, /* the picture stands before the background, as renderers of such scenes have it */
    SF_ALPHA_IGNORE /* colours are taken as they are, alpha is not used */
} sf_alpha;

/* How a project is read. Start from sf_load_options_default(). */
typedef struct sf_load_options {
    const char *images;    /* folder of the pictures inside the project, in the place of images; NULL: images,
                              else, with COLMAP, the largest of images_2, images_4, images_8 that exists (said
                              in the log) */
    int downscale;         /* box-average pictures by this, 1..64 */
    int hold_out;          /* every n-th view in name order, from the first, is held out; 0: none */
    const char *test_list; /* a text file with one picture name a line: these are held out instead */
    int max_views;         /* refuse projects with more views; 0: no limit */
    int64_t memory;        /* bytes, of the whole process: refuse pictures that take more; 0: 4/5 of what is
                              free. Simulated scenes are not checked */
    int sub_model;         /* which of a project's several models: sparse/N, the N-th reconstruction from 0;
                              -1: the one with most pictures (said in the log) */
    const char *masks;     /* folder of masks, inside the project or anywhere, where black is ignored;
                              NULL: masks, where there is one. What a project says of a view goes first */
    int no_masks;          /* masks are not read; alpha channels are */
    sf_alpha alpha;        /* what an alpha channel of a picture means */
    float background[3];   /* 0..1, behind pictures with an alpha channel that are blended */
} sf_load_options;

/* images NULL, downscale 1, hold_out 8, no list, no limit, memory 0, sub_model -1, masks as they are found,
 * alpha auto, background black. */
SF_API sf_load_options sf_load_options_default(void);

/* An empty scene, for views and points of the caller's. */
SF_API sf_status sf_scene_create(sf_context *context, sf_scene **scene);
SF_API void sf_scene_destroy(sf_scene **scene);

/* Reads a project: a COLMAP folder, a transforms.json, Blender's transforms_train.json or OpenSfM's
 * reconstruction.json, a folder that holds one, a .zip of any of these, or a simulated scene ("sim:studio",
 * see source.h). Pictures of lenses other than a pinhole become a pinhole camera's of the same focal lengths
 * and size; a fisheye's become as large as what it sees, up to 60 degrees on each side. Structural faults are
 * fatal and named; a picture that is missing or cannot be decoded and a pose that is not finite skip that
 * view, counted and reported to the log. SF_ERR_EMPTY: no training view is left; SF_ERR_MEMORY: also if the
 * pictures would not fit, before one is read; SF_ERR_CANCELLED. A .zip is unpacked to a folder under TMPDIR,
 * else /tmp, which is gone when the call returns; what a process that was killed there has left is removed by
 * the next call. */
SF_API sf_status sf_scene_load(sf_context *context, const char *path, const sf_load_options *options,
                               sf_scene **scene);

/* Ends each call of sf_scene_load on the context, that runs or that begins later, with SF_ERR_CANCELLED:
 * after the picture at hand. May be called from any thread and from the handler of a signal. */
SF_API void sf_scene_cancel_loads(sf_context *context);

/* A picture of the caller's, copied by sf_scene_add_view. */
typedef struct sf_pixels {
    const uint8_t *rgb;  /* [height][stride]: RGB, 3 bytes a pixel, sRGB values */
    size_t stride;       /* bytes a row, >= 3 width */
    const uint8_t *mask; /* [height][width], 0 ignores a pixel, 255 counts it in full; NULL: all count */
} sf_pixels;

/* Adds a view; *id (may be NULL) names it for sf_scene_remove_view. `name` is copied; NULL: "view-<id>". */
SF_API sf_status sf_scene_add_view(sf_scene *scene, const char *name, const sf_camera *camera,
                                   const sf_pixels *pixels, sf_split split, uint32_t *id);

/* The same with a picture file (JPEG or PNG); the camera's intrinsics are scaled if the file's size differs
 * from camera->width x height. */
SF_API sf_status sf_scene_add_file(sf_scene *scene, const char *path, const sf_camera *camera, sf_split split,
                                   uint32_t *id);

/* Takes a view out; a step that uses it ends first on its own copy. SF_ERR_ARGUMENT: no such id. */
SF_API sf_status sf_scene_remove_view(sf_scene *scene, uint32_t id);

/* Puts another pose (as in camera.h) in the place of view id's. A fit that has taken the view up goes on with
 * the one that it has: sf_fitter_set_pose. Safe from any thread. SF_ERR_ARGUMENT: no such view, no pose. */
SF_API sf_status sf_scene_set_pose(sf_scene *scene, uint32_t id, const double R_cw[9], const double t_cw[3]);

/* Appends sparse points: xyz [n][3] world units, rgb [n][3] or NULL (grey). Points that are not finite are
 * left out. */
SF_API sf_status sf_scene_add_points(sf_scene *scene, size_t count, const float *xyz, const uint8_t *rgb);

/* What a scene holds, and what of a project it does not. */
typedef struct sf_scene_info {
    size_t views, train_views, test_views, points; /* that it holds; views are of one split or the other */
    size_t skipped_missing;                        /* pictures missing, damaged, of another shape */
    size_t skipped_pose;                           /* poses or intrinsics not finite or not a rotation */
    size_t skipped_points;                         /* points not finite */
    size_t undistorted_views;                      /* views resampled to a pinhole camera */
    size_t cropped_views; /* of those: lost three degrees or more of what the lens saw across */
    size_t masked_views;  /* views with a mask */
    size_t alpha_views;   /* views whose picture has an alpha channel that is not opaque */
    size_t rotated_views; /* pictures with an EXIF orientation, which is ignored, as poses assume */
    const char *kind; /* static: "COLMAP", "transforms.json", "Blender", "OpenSfM", "simulated"; NULL: a scene
                         of the caller's */
    double extent;    /* 1.1 x the largest distance of a training camera from their mean; where that is 0,
                         the median distance from the cameras to the points, else 1 */
    double center[3]; /* mean of the training cameras' centres */
} sf_scene_info;

/* What the scene holds now. */
SF_API void sf_scene_get_info(sf_scene *scene, sf_scene_info *info);

/* A view of a scene. */
typedef struct sf_view_info {
    uint32_t id;      /* as sf_scene_add_view gave it; never given again */
    const char *name; /* stands while the view is in the scene */
    sf_split split;   /* what it is for */
    sf_camera camera; /* of the picture as kept: undistorted, downscaled */
    int has_mask;     /* not all of its pixels count in full */
    const char *lens; /* static: the project's camera model, for example "OPENCV"; NULL: not known */
    int undistorted;  /* resampled from that model to a pinhole camera */
    double field_seen, field_kept; /* degrees across the middle: by the lens, by the pinhole; 0: not known */
} sf_view_info;

/* The index-th view in order of adding (projects: in name order). SF_ERR_ARGUMENT: index >= views. */
SF_API sf_status sf_scene_get_view(sf_scene *scene, size_t index, sf_view_info *info);

/* Copies a view's picture to rgb [H][W][3] (0..1) and its weights to weight [H][W]; either may be NULL. */
SF_API sf_status sf_scene_get_pixels(sf_scene *scene, uint32_t id, float *rgb, float *weight);

/* Copies up to `capacity` points from index `first`; returns how many. */
SF_API size_t sf_scene_get_points(sf_scene *scene, size_t first, size_t capacity, float *xyz, uint8_t *rgb);

/* A 64-bit hash of all views (names, splits, cameras, pictures) and points: whether a scene is the one that a
 * run was made with. It finds accidents; it does not withstand a forger. SF_ERR_MEMORY. */
SF_API sf_status sf_scene_fingerprint(sf_scene *scene, uint64_t *fingerprint);

/* Writes the views' cameras as INRIA's cameras.json, atomically. */
SF_API sf_status sf_scene_save_cameras(sf_scene *scene, const char *path);

/* Reads a cameras.json: cameras without a picture. *cameras ([*count]) is freed by sf_cameras_free. Principal
 * points, which such files lack, are the pictures' middles. SF_ERR_IO; SF_ERR_FORMAT: names the camera and
 * the field; SF_ERR_EMPTY: there is none; SF_ERR_MEMORY. */
SF_API sf_status sf_cameras_load(sf_context *context, const char *path, sf_camera **cameras, size_t *count);
SF_API void sf_cameras_free(sf_context *context, sf_camera **cameras);

#ifdef __cplusplus
}
#endif
#endif
