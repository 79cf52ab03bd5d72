/* y4m.h - the header of a YUV4MPEG2 stream. */
#ifndef SF_CAPTURE_Y4M_H
#define SF_CAPTURE_Y4M_H

#include <splatfit/source.h>

#define SF_Y4M_MAGIC "YUV4MPEG2 "

typedef struct sf_y4m {
    int32_t width, height;
    sf_pixel_format format;
    double fps; /* 0: unknown */
    int full_range;
} sf_y4m;

/* Reads the header line without its newline; `line` is cut into words by it. On failure `fault` (room bytes)
 * says why: SF_ERR_FORMAT, SF_ERR_UNSUPPORTED. */
sf_status sf_y4m_parse(char *line, sf_y4m *header, char *fault, size_t room);

#endif
