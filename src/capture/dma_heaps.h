/* dma_heaps.h - whether this system gives memory that cameras can share.
 *
 * libcamera takes the frames of some cameras (a Raspberry Pi's, its virtual ones) from a DMA heap of the
 * kernel, or from /dev/udmabuf: the same devices, in its order (dma_buf_allocator.cpp of 0.7.1).
 */
#ifndef SF_CAPTURE_DMA_HEAPS_H
#define SF_CAPTURE_DMA_HEAPS_H

#include <stddef.h>

/* Writes into `text` what is missing under `dev` ("/dev") and what to do about it; nothing where one of the
 * devices can be opened. */
void sf_dma_heaps_explain(const char *dev, char *text, size_t bytes);

#endif
