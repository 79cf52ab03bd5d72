/* colmap_text.h - COLMAP's text files. */
#ifndef SF_IO_COLMAP_TEXT_H
#define SF_IO_COLMAP_TEXT_H

#include "colmap_records.h"

/* Each reads a whole file, of which `data` (ended by 0) is cut into words, in a locale whose numbers have a
 * point. SF_ERR_FORMAT: a word is not what it should be. */
sf_status sf_colmap_parse_cameras(sf_colmap_reader *r, char *data);
sf_status sf_colmap_parse_images(sf_colmap_reader *r, char *data);
sf_status sf_colmap_parse_points(sf_colmap_reader *r, char *data);

/* The images of an images.txt, which may be damaged; `data` is cut into lines. */
uint64_t sf_colmap_count_lines(char *data);

#endif
