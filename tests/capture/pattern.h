/* pattern.h - frames that are told apart by an id, and checked to the last bit by a CRC, both in their
 * pixels. */
#ifndef PATTERN_H
#define PATTERN_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/source.h>

/* One plane of a picture. Only the first `width` bytes of a row are the picture's. */
typedef struct pattern_plane {
    uint8_t *data;
    size_t stride, width; /* bytes; width at least 8 */
    size_t rows;
} pattern_plane;

/* Widths and rows of the planes of a picture without compression; their number. */
int pattern_planes(sf_pixel_format format, int width, int height, pattern_plane planes[SF_FRAME_PLANES]);

/* Every plane gets 4 bytes of id and plane, 4 bytes of CRC-32 of the rest, and noise that both decide. */
void pattern_fill(const pattern_plane *planes, int count, uint32_t id);

/* A frame's id; -1: some plane is not what pattern_fill made, or of another frame than the first. */
int64_t pattern_id(const sf_frame *frame);

/* A JPEG of 8-bit grey noise with room for a mark in a comment after its first two bytes: bytes in *size, at
 * most `capacity`; 0: it cannot be made. */
int pattern_jpeg(uint8_t *jpeg, size_t capacity, int width, int height, uint32_t id, size_t *size);

/* Puts the id and the CRC-32 of what follows into the comment. */
void pattern_mark_jpeg(uint8_t *jpeg, size_t size, uint32_t id);

#endif
