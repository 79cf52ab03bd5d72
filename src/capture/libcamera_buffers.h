/* libcamera_buffers.h - the memory of a camera's buffers, mapped. */
#ifndef SF_CAPTURE_LIBCAMERA_BUFFERS_H
#define SF_CAPTURE_LIBCAMERA_BUFFERS_H

#include "libcamera_device.h"
#include "libcamera_format.h"

/* A plane of a buffer: `length` bytes from `offset` on of what a descriptor, libcamera's own, stands for. */
typedef struct sf_libcamera_plane {
    int fd;
    size_t offset, length;
} sf_libcamera_plane;

/* A buffer that is mapped; all 0: none. */
typedef struct sf_libcamera_buffer {
    const uint8_t *plane[SF_FRAME_PLANES];
    size_t length[SF_FRAME_PLANES];
    int dmabuf; /* the first plane's descriptor */
    struct {
        int fd;
        void *memory; /* NULL: that plane lies in the memory of an earlier one */
        size_t bytes;
    } mapping[SF_FRAME_PLANES];
} sf_libcamera_buffer;

/* Maps a buffer of `count` planes, for reading; planes may share a descriptor: each is mapped once.
 * SF_ERR_UNSUPPORTED: fewer planes or bytes than the picture takes; SF_ERR_IO. What was mapped until then
 * stays, for sf_libcamera_unmap. */
sf_status sf_libcamera_map(const sf_libcamera_device *device, const sf_libcamera_picture *picture,
                           const sf_libcamera_plane *planes, size_t count, sf_libcamera_buffer *buffer);
void sf_libcamera_unmap(sf_libcamera_buffer *buffer);

#endif
