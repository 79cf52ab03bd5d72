/* origin.h - a project's local origin. */
#ifndef SF_IO_ORIGIN_H
#define SF_IO_ORIGIN_H

#include "dataset.h"

/* Where cameras and points lie so far from 0 that floats there are coarse (UTM, ECEF): chooses
 * project->origin among them, subtracts it from all, and says so in the log. Otherwise the origin stays 0.
 * SF_ERR_MEMORY. */
sf_status sf_project_move_origin(sf_project *project);

#endif
