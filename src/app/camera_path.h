/* camera_path.h - the cameras along a path: around a model, through a project's cameras, or as a file says.
 */
#ifndef APP_CAMERA_PATH_H
#define APP_CAMERA_PATH_H

#include "app.h"

typedef struct camera_path {
    sf_camera *cameras; /* [count] */
    size_t count;
    double rate;       /* a second */
    double near_plane; /* what suits an orbit, world units; 0: as in a fit of the project */
} camera_path;

/* --path and all that goes with it. */
extern const arg_option camera_path_options[];

/* Refuses options that go with --path where that is not given. 0 or an exit code. */
int camera_path_check(const args *a);

/* The cameras that the options say; scene may be NULL. The model gets their origin, where it states none. 0
 * or an exit code; camera_path_free in both cases. */
int camera_path_make(const args *a, sf_context *ctx, sf_model *model, sf_scene *scene, camera_path *s);
void camera_path_free(camera_path *s);

/* The lines of a path that leads along the same poses, in the world's coordinates; free() it. NULL: out of
 * memory. */
char *camera_path_lines(const camera_path *s, const sf_model *model);

/* The cameras that are known: of the scene's views that --split wants, else of the file that --cameras names,
 * else of those beside the model (app_find_cameras_beside); *count 0 where there are none. In the model's
 * coordinates: one that states no origin gets the file's (sf_scene_place_model). free() them. 0 or an exit
 * code. */
int camera_path_known(const args *a, sf_context *ctx, sf_model *model, sf_scene *scene, sf_camera **cameras,
                      size_t *count);

/* A camera relative to `origin` becomes one relative to `to`. */
void camera_path_change_origin(sf_camera *camera, const double origin[3], const double to[3]);

/* A camera at `from` that looks at `at`, with `up` upwards in the picture, of c's size and lens. */
void camera_path_look_at(const double from[3], const double at[3], const double up[3], sf_camera *c);

/* scene_center.c: whether the model lies around `center` (its medians), seen along the first of `axes`, up,
 * with the others, ahead and sidewards, at right angles, and leaves it empty. Where it lies around the center
 * of its extent instead, *center becomes that. 0 or an exit code. */
int camera_path_find_center(const args *a, sf_context *ctx, const sf_model *model,
                            const double *const axes[3], double center[3], int *around);

/* orbit.c: cameras around a model, or in its center where it lies around that; count of them, whose sizes and
 * lenses are set. */
int camera_path_orbit(const args *a, sf_context *ctx, const sf_model *model, const sf_camera *known,
                      size_t known_count, camera_path *s);

#endif
