/* load_project.h - reads a project of any kind as a scene. */
#ifndef SF_IO_LOAD_PROJECT_H
#define SF_IO_LOAD_PROJECT_H

#include "../base/context.h"

#include <splatfit/scene.h>

/* Reads a COLMAP folder, a transforms.json, or a folder that holds one. `options` may be NULL. Pictures are
 * decoded by all threads, each held at full size only while it is worked on. Errors as sf_scene_load;
 * SF_ERR_ARGUMENT: an option out of range, more than max_views. */
sf_status sf_project_load(sf_context *ctx, const char *path, const sf_load_options *options,
                          sf_scene **scene);

#endif
