/* zip.h - projects in a .zip. */
#ifndef SF_IO_ZIP_H
#define SF_IO_ZIP_H

#include "../base/context.h"

/* Whether a file begins as those of zip do. */
int sf_zip_is(const char *path);

/* Unpacks the pictures, models and lists of an archive into a new folder under TMPDIR, else /tmp. *folder is
 * for sf_zip_remove, *project, sf_free'd by the caller, the folder in it that has the archive's name. Before
 * anything is written all sizes and names are checked: what the archive announces must be possible for its
 * bytes and the disk's room, and no name leads out. SF_ERR_UNSUPPORTED: built without libzip, encrypted;
 * SF_ERR_FORMAT: damaged, a name that leads out, sizes that lie; SF_ERR_IO: the disk. */
sf_status sf_zip_unpack(sf_context *ctx, const char *path, char **folder, char **project);

/* Removes the folder with all that is in it, and frees the name; NULL is allowed. */
void sf_zip_remove(sf_context *ctx, char *folder);

#endif
