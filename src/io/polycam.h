/* polycam.h - Polycam's raw export: a folder with keyframes/, as the app writes it in its developer mode. */
#ifndef SF_IO_POLYCAM_H
#define SF_IO_POLYCAM_H

#include "dataset.h"

/* Whether the folder holds keyframes/corrected_cameras or keyframes/cameras, or is the first
 * one's keyframes/. */
int sf_polycam_is(const char *folder);

/* Appends a picture for each file of keyframes/corrected_cameras, with its picture in
 * keyframes/corrected_images; where one of the two folders is missing, or options->images is
 * "keyframes/images", for each of keyframes/cameras, with its picture in keyframes/images. */
sf_status sf_polycam_read(sf_project *project, const char *folder, const sf_load_options *options);

#endif
