/* zip.h - projects in a .zip. */
#ifndef SF_IO_ZIP_H
#define SF_IO_ZIP_H

#include "../base/context.h"

/* Whether a file begins as those of zip do. */
int sf_zip_is(const char *path);

/* What an archive was unpacked to. */
typedef struct sf_unpacked {
    char *folder;  /* a new one */
    char *project; /* the folder in it that has the archive's name */
    int lock;      /* an open file in it: as long as somebody holds its lock, it is in use */
} sf_unpacked;

/* Unpacks the pictures, models and lists of an archive into a new folder under TMPDIR, else /tmp. Before
 * anything is written all sizes and names are checked: what the archive announces must be possible for its
 * bytes and the disk's room, and no name leads out. What processes that were killed have left there is
 * removed. SF_ERR_UNSUPPORTED: built without libzip, encrypted; SF_ERR_FORMAT: damaged, a name that leads
 * out, sizes that lie; SF_ERR_IO: the disk; SF_ERR_CANCELLED. After a failure there is nothing to remove. */
sf_status sf_zip_unpack(sf_context *ctx, const char *path, sf_unpacked *unpacked);

/* Removes the folder with all that is in it. */
void sf_zip_remove(sf_context *ctx, sf_unpacked *unpacked);

#endif
