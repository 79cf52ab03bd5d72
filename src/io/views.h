/* views.h - the views of a project: its pictures read, undistorted, made smaller, with their masks. */
#ifndef SF_IO_VIEWS_H
#define SF_IO_VIEWS_H

#include "dataset.h"

/* The scene of a project whose entries are sorted and split. Pictures are decoded by all threads. */
sf_status sf_project_build(const sf_project *project, const sf_load_options *options, sf_scene **scene);

#endif
