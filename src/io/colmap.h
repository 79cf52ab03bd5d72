/* colmap.h - COLMAP's sparse models, binary and text. */
#ifndef SF_IO_COLMAP_H
#define SF_IO_COLMAP_H

#include <splatfit/calibrate.h>

#include "dataset.h"

/* The folder of the model in a project: sparse/N (of several the one with most images, said in the log),
 * sparse, or the project itself; with `number` >= 0 sparse/<number> alone. *model is sf_free'd by the caller;
 * NULL where there is none. SF_ERR_IO: there are models, but none of that number. */
sf_status sf_colmap_find(sf_context *ctx, const char *path, int number, char **model);

/* Reads cameras, images and points of that model into an empty project. */
sf_status sf_colmap_read(sf_project *project, const char *path, const char *model,
                         const sf_load_options *options);

/* The one camera of a cameras.txt or cameras.bin (`binary`) whose content is `data`, which a 0 byte follows:
 * its size and lens alone are set. SF_ERR_FORMAT: damaged, no camera; SF_ERR_UNSUPPORTED: a lens that is not
 * an sf_lens, cameras that differ.
 */
sf_status sf_colmap_read_camera(sf_context *ctx, const char *file, int binary, uint8_t *data, size_t size,
                                sf_calibration *camera);

#endif
