/* photo_cameras.h - which photos one camera took, and what is known of its lens before anything is matched.
 */
#ifndef SF_SFM_PHOTO_CAMERAS_H
#define SF_SFM_PHOTO_CAMERAS_H

#include "reconstruction.h"

/* Gives each photo of r->list that can be read a camera: photos of one make, model, focal length and size
 * share one. Where nothing of that is told, size alone decides. A photo on its side has the camera of the
 * upright ones, and is turned: GEOMETRY.md, S.22. Sets r->cameras, r->camera_of and r->is_turned.
 * SF_ERR_EMPTY: no photo can be read; SF_ERR_ARGUMENT: a photo has not the size of the lens that the options
 * give; SF_ERR_MEMORY. */
sf_status sf_photo_cameras(sf_reconstruction *r, const char *folder, const sf_sfm_options *options);

/* A photo's pixel in its camera's picture, and back: the same unless the photo is turned. */
void sf_photo_turn(const sf_reconstruction *r, size_t photo, double x, double y, double pixel[2]);

/* The pose of a photo that has the camera's one, world to camera. */
sf_rigid sf_photo_pose(const sf_reconstruction *r, size_t photo, const sf_rigid *pose);

/* A camera's lens in its photos as they are, or in those on their side. */
sf_lens sf_photo_lens(const sf_map_camera *camera, int is_turned);

#endif
