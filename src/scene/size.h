/* size.h - centre and size of a scene, by medians: single cameras and points far from all others do not
 * count. */
#ifndef SF_SCENE_SIZE_H
#define SF_SCENE_SIZE_H

#include "scene.h"

/* Sets info->center and info->extent from the training cameras and the points. The caller holds the lock, and
 * has set info->train_views. */
void sf_measure_size(const sf_scene *scene, sf_scene_info *info);

/* The largest distance of a training camera from the mean of all, without those far from all others; 0 where
 * all are in one place, up to rounding. center: that mean. The lock is held. */
double sf_camera_spread(const sf_scene *scene, double center[3]);

#endif
