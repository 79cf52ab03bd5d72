/* libcamera_buffers.c - see libcamera_buffers.h. */
#include "libcamera_buffers.h"

#include <errno.h>
#include <sys/mman.h>
#include <unistd.h>

/* The memory of a descriptor, up to `bytes`, for plane `plane`; NULL: it cannot be mapped. */
static const uint8_t *memory_of(sf_libcamera_buffer *buffer, int plane, int fd, size_t bytes) {
    for (int i = 0; i < plane; i++)
        if (buffer->mapping[i].memory && buffer->mapping[i].fd == fd) return buffer->mapping[i].memory;
    void *memory = mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED) return NULL;
    buffer->mapping[plane].fd = fd;
    buffer->mapping[plane].memory = memory;
    buffer->mapping[plane].bytes = bytes;
    return memory;
}

static sf_status map_plane(const sf_libcamera_device *device, const sf_libcamera_plane *p, size_t need,
                           int plane, sf_libcamera_buffer *buffer) {
    off_t bytes = lseek(p->fd, 0, SEEK_END);
    if (bytes < 0 || p->length < need || p->offset > (size_t)bytes || p->length > (size_t)bytes - p->offset)
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0,
                                 "has a buffer that is shorter than a picture");
    const uint8_t *memory = memory_of(buffer, plane, p->fd, (size_t)bytes);
    if (!memory) return sf_libcamera_fail(device, SF_ERR_IO, errno, "a buffer cannot be mapped");
    buffer->plane[plane] = memory + p->offset;
    buffer->length[plane] = p->length;
    return SF_OK;
}

sf_status sf_libcamera_map(const sf_libcamera_device *device, const sf_libcamera_picture *picture,
                           const sf_libcamera_plane *planes, size_t count, sf_libcamera_buffer *buffer) {
    int needed = sf_libcamera_planes(picture);
    if (count < (size_t)needed)
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "has fewer planes than its format");
    buffer->dmabuf = planes[0].fd;
    sf_status status = SF_OK;
    for (int i = 0; i < needed && status == SF_OK; i++)
        status = map_plane(device, &planes[i], sf_libcamera_plane_bytes(picture, i), i, buffer);
    return status;
}

void sf_libcamera_unmap(sf_libcamera_buffer *buffer) {
    for (int i = 0; i < SF_FRAME_PLANES; i++)
        if (buffer->mapping[i].memory) munmap(buffer->mapping[i].memory, buffer->mapping[i].bytes);
    *buffer = (sf_libcamera_buffer){.dmabuf = -1};
}
