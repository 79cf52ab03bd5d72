/* colmap_binary.h - COLMAP's binary files. */
#ifndef SF_IO_COLMAP_BINARY_H
#define SF_IO_COLMAP_BINARY_H

#include "../base/bytes.h"
#include "colmap_records.h"

/* Each reads a whole file. SF_ERR_FORMAT: it is damaged, cut off, or goes on behind its last record. */
sf_status sf_colmap_read_cameras(sf_colmap_reader *r, sf_bytes *b);
sf_status sf_colmap_read_images(sf_colmap_reader *r, sf_bytes *b);
sf_status sf_colmap_read_points(sf_colmap_reader *r, sf_bytes *b);

#endif
