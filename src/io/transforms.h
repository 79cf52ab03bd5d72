/* transforms.h - transforms.json as instant-ngp, nerfstudio and Blender write it. */
#ifndef SF_IO_TRANSFORMS_H
#define SF_IO_TRANSFORMS_H

#include "dataset.h"

/* Appends the frames of a file, and takes its points where it names some. options->images stands for the
 * folder images/ of its pictures. */
sf_status sf_transforms_read(sf_project *project, const char *file, const sf_load_options *options);

/* Reads Blender's transforms_train.json and, if it is there, transforms_test.json of a folder, else
 * transforms_val.json, split so. */
sf_status sf_transforms_read_pair(sf_project *project, const char *folder, const sf_load_options *options);

/* Sets an entry's pose from the matrix, by rows, from the camera to the world, where the camera's axes are
 * OpenGL's (+y up, +z back). */
void sf_entry_set_opengl_pose(sf_entry *e, const double c2w[16]);

#endif
