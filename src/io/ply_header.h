/* ply_header.h - where the header of a binary .ply ends, before anything of it is understood. */
#ifndef SF_IO_PLY_HEADER_H
#define SF_IO_PLY_HEADER_H

#include <stddef.h>
#include <stdint.h>

/* A file with a longer header is read as text is: whole. */
enum { SF_PLY_HEADER_MOST = 1 << 16 };

/* Reads the start of a file into data[SF_PLY_HEADER_MOST + 1], which a 0 ends. Returns the length of its
 * header, up to the first row; 0: this is no binary .ply, or has a longer one. */
size_t sf_ply_binary_header(const char *path, uint8_t *data);

#endif
