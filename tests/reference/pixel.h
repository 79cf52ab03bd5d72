/* pixel.h - one pixel of a frame in float64, from the definition of its format. */
#ifndef TESTS_PIXEL_H
#define TESTS_PIXEL_H

#include <splatfit/source.h>

/* sRGB values in 0..1 of pixel (x, y); any format but SF_PIXEL_MJPEG. */
void test_ref_pixel(const sf_frame *frame, int32_t x, int32_t y, double rgb[3]);

#endif
