/* zip_write.h - archives of files that are packed already. */
#ifndef SF_IO_ZIP_WRITE_H
#define SF_IO_ZIP_WRITE_H

#include "../base/file.h"

enum { SF_ZIP_ENTRIES = 8 };

typedef struct sf_zip_writer {
    sf_writer *w;
    size_t entries;
    uint64_t at; /* bytes so far */
    struct {
        const char *name;
        uint32_t crc, size, at;
    } entry[SF_ZIP_ENTRIES];
} sf_zip_writer;

/* Adds a file, as it is, under a name that stays where it is until the end; at most SF_ZIP_ENTRIES.
 * SF_ERR_UNSUPPORTED: the archive would be larger than 4 GiB. */
sf_status sf_zip_put(sf_zip_writer *zip, const char *name, const void *data, size_t size);
/* After the last one. */
void sf_zip_end(sf_zip_writer *zip);

#endif
