/* cameras_json.h - cameras.json of cameras that are not quite the scene's. */
#ifndef SF_IO_CAMERAS_JSON_H
#define SF_IO_CAMERAS_JSON_H

#include "../scene/scene.h"

/* Puts the camera to write for view `id` in the place of the scene's. */
typedef void (*sf_camera_fn)(void *user, uint32_t id, sf_camera *camera);

/* sf_scene_save_cameras of the cameras that `replace` (may be NULL) gives; it must not call the scene. */
sf_status sf_save_cameras(sf_scene *scene, sf_camera_fn replace, void *user, const char *path, int world);

#endif
