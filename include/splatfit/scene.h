/* scene.h - the data that a model is fitted to: views (a picture and its camera) and sparse points.
 *
 * Views may be added and removed from any thread while a fitter works on the scene. Pictures are kept with
 * 8 bits a channel.
 */
#ifndef SPLATFIT_SCENE_H
#define SPLATFIT_SCENE_H

#include <stdint.h>

#include "camera.h"
#include "context.h"
#include "model.h"

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
    SF_ALPHA_AUTO,  /* blend in Blender projects (transforms_train.json), else mask */
    SF_ALPHA_MASK,  /* alpha is a pixel's weight: 0 ignores it, the largest value counts it in full */
    SF_ALPHA_BLEND, /* the picture is blended over the background */
    SF_ALPHA_IGNORE /* alpha is not used, colours are unchanged */
} sf_alpha;

/* How a project is read. Start from sf_load_options_default(). */
typedef struct sf_load_options {
    const char *images;    /* folder of the pictures inside the project; NULL: images, else the largest of
                              images_2, images_4, images_8 that exists (logged; COLMAP, transforms.json) */
    int downscale;         /* box-average pictures by this, 1..64; libjpeg does a part of it for JPEGs */
    int hold_out;          /* every n-th view in name order, from the first, is held out; 0: none */
    const char *test_list; /* a text file with one picture name a line: these are held out instead */
    int max_views;         /* refuse projects with more views; 0: no limit */
    int64_t memory;        /* bytes for the whole process; 0: 4/5 of what is free. Pixels that take more than
                              half of it go to a temporary file, see sf_scene_load */
    int sub_model;         /* of a project with several models: sparse/N or the N-th reconstruction, from 0;
                              -1: the one with most pictures (logged) */
    const char *masks;     /* folder of masks, inside the project or elsewhere; black is ignored. NULL: the
                              folder masks, if it exists. A mask that the project names for a view is preferred */
    int no_masks;          /* 1: masks are not read; alpha channels are */
    sf_alpha alpha;        /* the meaning of an alpha channel */
    float background[3];   /* 0..1, behind pictures that are blended (SF_ALPHA_BLEND) */
    int no_pixels;         /* 1: of pictures and masks only the headers are read; the scene serves for its
                              counts, cameras and points. Simulated scenes are drawn all the same */
} sf_load_options;

/* images NULL, downscale 1, hold_out 8, test_list NULL, max_views 0, memory 0, sub_model -1, masks NULL,
 * alpha auto, background black, no_pixels 0. */
SF_API sf_load_options sf_load_options_default(void);

/* An empty scene, to which the caller adds views and points. */
SF_API sf_status sf_scene_create(sf_context *context, sf_scene **scene);
SF_API void sf_scene_destroy(sf_scene **scene);

/* Reads a project: a COLMAP folder, a transforms.json, Blender's transforms_train.json or OpenSfM's
 * reconstruction.json, a folder that holds one, a .zip of any of these, or a simulated scene ("sim:studio",
 * see source.h). Pictures of distorted lenses are resampled to a pinhole camera of the same focal lengths and
 * size; those of a fisheye become as large as its field of view, up to 60 degrees on each side. Structural
 * faults are fatal and named. A view whose picture is missing or damaged, or whose pose is not finite, is
 * skipped, counted and logged. Pictures whose pixels take more than half of options->memory are read again
 * and again from a file without a name, which ends with the scene: in TMPDIR, /var/tmp or /tmp, the first
 * that is on a disk and has the room; where none is, they stay in memory if it holds them. SF_ERR_EMPTY: no
 * training view is left; SF_ERR_IO: also if neither memory nor a disk takes the pictures, or the disk is
 * full; SF_ERR_MEMORY: also if the memory holds not even a few; SF_ERR_CANCELLED. A .zip is unpacked to a
 * folder under TMPDIR, else /tmp, which is removed when the call returns; a folder that a killed process left
 * is removed by the next call. */
SF_API sf_status sf_scene_load(sf_context *context, const char *path, const sf_load_options *options,
                               sf_scene **scene);

/* Ends every sf_scene_load on the context, running or later, with SF_ERR_CANCELLED after the current picture.
 * May be called from any thread and from a signal handler. */
SF_API void sf_scene_cancel_loads(sf_context *context);

/* The caller's picture, copied by sf_scene_add_view. */
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

/* Removes a view; a training step that is using the view keeps it until the step ends. SF_ERR_ARGUMENT: no
 * such id. */
SF_API sf_status sf_scene_remove_view(sf_scene *scene, uint32_t id);

/* Replaces the pose of view `id` (conventions as in camera.h). A fit that already trains on the view keeps
 * its own pose of it: see sf_fitter_set_pose. Safe from any thread. SF_ERR_ARGUMENT: no such view, values
 * that are not a pose. */
SF_API sf_status sf_scene_set_pose(sf_scene *scene, uint32_t id, const double R_cw[9], const double t_cw[3]);

/* Appends sparse points: xyz [n][3] world units, rgb [n][3] or NULL (grey). Points that are not finite are
 * left out. */
SF_API sf_status sf_scene_add_points(sf_scene *scene, size_t count, const float *xyz, const uint8_t *rgb);

/* The contents of a scene, and what was skipped of its project. */
typedef struct sf_scene_info {
    size_t views, train_views, test_views, points; /* in the scene; views = train_views + test_views */
    size_t skipped_missing;                        /* pictures missing, damaged, of another shape */
    size_t skipped_pose;                           /* poses or intrinsics not finite or not a rotation */
    size_t skipped_points;                         /* points not finite */
    size_t undistorted_views;                      /* views resampled to a pinhole camera */
    size_t cropped_views; /* undistorted views that lost three degrees or more of the lens's field of view */
    size_t masked_views;  /* views with a mask */
    size_t alpha_views;   /* views whose picture has an alpha channel that is not opaque (no_pixels: that has
                             an alpha channel) */
    size_t rotated_views; /* pictures with an EXIF orientation, which is ignored, as poses assume */
    const char *kind; /* static: "COLMAP", "transforms.json", "Blender", "OpenSfM", "simulated"; NULL: made
                         by the caller */
    double extent; /* size of the scene: the median over the training views of the median depth of the points
                      that they see; without points 1.1 x the largest distance of a training camera from
                      their mean, else 1 */
    double center[3]; /* mean of the training cameras' centres. Both without cameras that are 5 times as far
                         from all as is usual */
} sf_scene_info;

/* What the scene holds now. */
SF_API void sf_scene_get_info(sf_scene *scene, sf_scene_info *info);

/* The origin of the scene's coordinates in the world of its project: 0, or, where cameras and points lie far
 * from 0, a place among them. It is subtracted when a project is loaded, and must be added to get the
 * project's coordinates. */
SF_API void sf_scene_get_origin(const sf_scene *scene, double origin[3]);
/* States that origin; nothing moves. For a caller that adds views and points in coordinates far from 0: it
 * subtracts an origin among them before, since points and Gaussians are floats. Models that are fitted later
 * state it, too. SF_ERR_ARGUMENT: not finite. */
SF_API sf_status sf_scene_set_origin(sf_scene *scene, const double origin[3]);

/* Gives a model the scene's origin (sf_model_set_origin). A model that states none has the scene's
 * coordinates already, or the world's: those in which it lies nearer to 0, by the medians of its means. */
SF_API void sf_scene_place_model(const sf_scene *scene, sf_model *model);

/* A view of a scene. */
typedef struct sf_view_info {
    uint32_t id;      /* as sf_scene_add_view gave it; never reused */
    const char *name; /* valid while the view is in the scene */
    sf_split split;   /* training or held out */
    sf_camera camera; /* of the picture as kept: undistorted, downscaled */
    int has_mask;     /* some pixels may have a weight below 1 */
    const char *lens; /* static: the project's camera model, for example "OPENCV"; NULL: not known */
    int undistorted;  /* resampled from that model to a pinhole camera */
    double field_seen, field_kept; /* degrees across the middle: by the lens, by the pinhole; 0: not known */
    const char *file;              /* of its picture, valid as the name is; NULL: it was added without one */
} sf_view_info;

/* The index-th view in order of adding (projects: in name order). SF_ERR_ARGUMENT: index >= views. */
SF_API sf_status sf_scene_get_view(sf_scene *scene, size_t index, sf_view_info *info);

/* Copies a view's picture to rgb [H][W][3] (0..1) and its weights to weight [H][W]; either may be NULL.
 * SF_ERR_ARGUMENT: no such view; its picture was not read (no_pixels). SF_ERR_IO, SF_ERR_MEMORY: of a picture
 * in a file. */
SF_API sf_status sf_scene_get_pixels(sf_scene *scene, uint32_t id, float *rgb, float *weight);

/* Copies up to `capacity` points from index `first`; returns how many. */
SF_API size_t sf_scene_get_points(sf_scene *scene, size_t first, size_t capacity, float *xyz, uint8_t *rgb);

/* A 64-bit hash of all views (names, splits, cameras, pictures) and points, for checking that a scene is the
 * one of an earlier run. It is not cryptographic. SF_ERR_MEMORY, SF_ERR_IO. */
SF_API sf_status sf_scene_fingerprint(sf_scene *scene, uint64_t *fingerprint);

/* Writes the views' cameras as INRIA's cameras.json, atomically. world 0: positions relative to the scene's
 * origin, which each camera states as "origin" where it is not 0; 1: relative to the world's 0. SF_ERR_IO,
 * SF_ERR_MEMORY. */
SF_API sf_status sf_scene_save_cameras(sf_scene *scene, const char *path, int world);

/* Reads a cameras.json: cameras without a picture. *cameras ([*count]) is freed by sf_cameras_free. Principal
 * points, which such files lack, are the pictures' middles. origin: what the poses are relative to in the
 * world, as the file states it; NULL: they are in the world's coordinates. SF_ERR_IO; SF_ERR_FORMAT: names
 * the camera and the field; SF_ERR_EMPTY: the file has no camera; SF_ERR_MEMORY. */
SF_API sf_status sf_cameras_load(sf_context *context, const char *path, sf_camera **cameras, size_t *count,
                                 double origin[3]);
SF_API void sf_cameras_free(sf_context *context, sf_camera **cameras);

#ifdef __cplusplus
}
#endif
#endif
