/* ply_header.c - see ply_header.h. */
#include "ply_header.h"

#include <string.h>

#include "../base/file.h"

size_t sf_ply_binary_header(const char *path, uint8_t *data) {
    size_t size = sf_read_start(path, data, SF_PLY_HEADER_MOST);
    data[size] = 0;
    const char *text = (char *)data, *end = strstr(text, "\nend_header");
    const char *binary = strstr(text, "\nformat binary_"), *last = end ? strchr(end + 1, '\n') : NULL;
    return last && binary && binary < end ? (size_t)(last + 1 - text) : 0;
}
