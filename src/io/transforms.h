/* transforms.h - transforms.json as instant-ngp, nerfstudio and Blender write it. */
#ifndef SF_IO_TRANSFORMS_H
#define SF_IO_TRANSFORMS_H

#include "project.h"

/* Appends the frames of a file, and takes its points where it names some. */
sf_status sf_transforms_read(sf_project *project, const char *file);

/* Reads Blender's transforms_train.json and, if it is there, transforms_test.json of a folder, split so. */
sf_status sf_transforms_read_pair(sf_project *project, const char *folder);

#endif
