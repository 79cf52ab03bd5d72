/* jpeg_cut.h - finds where the JPEGs of a stream begin and end.
 *
 * Segments are stepped over by their lengths, so that the thumbnails within them are not seen; in the coded
 * pixels only a marker ends them. What lies between two JPEGs is passed over.
 */
#ifndef SF_CAPTURE_JPEG_CUT_H
#define SF_CAPTURE_JPEG_CUT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sf_jpeg_event {
    SF_JPEG_MORE,   /* all bytes were taken, nothing happened */
    SF_JPEG_BEGIN,  /* the two bytes FF D8 of a JPEG were taken, the first one maybe in the call before */
    SF_JPEG_WHOLE,  /* the JPEG that began ends with the last byte taken */
    SF_JPEG_BROKEN, /* what began is no JPEG, was cut off, or is too short for its size */
} sf_jpeg_event;

/* All zero at the begin of a stream. */
typedef struct sf_jpeg_cutter {
    int state, marker;
    size_t length, at;     /* of the segment that is stepped over */
    uint64_t bytes;        /* of the JPEG, up to now */
    int pixels;            /* coded pixels were met */
    int32_t width, height; /* px, of the JPEG that is whole; both at least 1 */
} sf_jpeg_cutter;

/* Takes bytes up to the next event, *taken of `size`. */
sf_jpeg_event sf_jpeg_cut(sf_jpeg_cutter *cutter, const uint8_t *data, size_t size, size_t *taken);

/* Whether a JPEG has begun and not ended. */
int sf_jpeg_inside(const sf_jpeg_cutter *cutter);

/* The size of a JPEG that is whole from its first byte on. 0: it is not. */
int sf_jpeg_size(const uint8_t *data, size_t size, int32_t *width, int32_t *height);

/* The bytes of a camera's JPEG up to and with its last end marker; 0: it does not begin as one, or was cut
 * off. Some cameras fill the buffer up behind the marker, with zeros or with what was there before. */
size_t sf_jpeg_end(const uint8_t *data, size_t size);

#ifdef __cplusplus
}
#endif

#endif
