/* opensfm.h - OpenSfM's reconstruction.json, as OpenSfM and OpenDroneMap write it. */
#ifndef SF_IO_OPENSFM_H
#define SF_IO_OPENSFM_H

#include "dataset.h"

/* Whether a file's first character that is not white space is [, as that of an array. */
int sf_opensfm_is(const char *file);

/* Appends the shots of one reconstruction of the file (options->sub_model, else the one with most shots, said
 * in the log), and takes its points. Pictures are in images/ beside the file or beside its folder
 * (options->images names another folder). */
sf_status sf_opensfm_read(sf_project *project, const char *file, const sf_load_options *options);

#endif
