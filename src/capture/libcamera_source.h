/* libcamera_source.h - the source behind libcamera:, apart from libcamera's own types.
 *
 * A fixed set of buffers goes round: queued in the camera, filled on libcamera's thread, which puts them into
 * the queue, taken from there by sf_source_next, and given to the camera again when the frame is given back.
 * libcamera.cc opens the camera and translates; a test can play it.
 */
#ifndef SF_CAPTURE_LIBCAMERA_SOURCE_H
#define SF_CAPTURE_LIBCAMERA_SOURCE_H

#include "libcamera_buffers.h"
#include "libcamera_controls.h"
#include "libcamera_queue.h"
#include "source_ops.h"

/* What the source asks of the camera, the first argument of each. */
typedef struct sf_libcamera_calls {
    /* Lets the camera fill a buffer again, and sets controls with that. What the camera refuses is lost and
     * no error: the others go on. */
    sf_status (*queue)(void *camera, size_t buffer, const sf_libcamera_controls *set);
    /* Closes it, and the source with sf_libcamera_source_end. */
    void (*close)(void *camera);
} sf_libcamera_calls;

/* Filled in by whoever opens the camera, all 0 before. */
typedef struct sf_libcamera_source {
    sf_libcamera_device device;
    const sf_libcamera_calls *calls;
    void *camera;
    char model[96];
    sf_libcamera_request asked;
    sf_libcamera_has has;
    sf_libcamera_picture picture;
    sf_libcamera_buffer *buffers;
    size_t count; /* of the buffers */
    sf_libcamera_queue queue;
    int locked, lock_is_new; /* goes with the next buffer */
    int said_gone;
} sf_libcamera_source;

/* Checks the picture, and makes room for `count` buffers and the queue, before the first one is mapped.
 * SF_ERR_UNSUPPORTED: a stride shorter than a row, or fewer buffers than frames may be out; SF_ERR_MEMORY. */
sf_status sf_libcamera_source_begin(sf_libcamera_source *source, size_t count);

/* Unmaps the buffers and ends the queue; libcamera's thread must be done with both. */
void sf_libcamera_source_end(sf_libcamera_source *source);

/* `self` is an sf_libcamera_source. */
extern const sf_source_ops sf_libcamera_source_ops;

#endif
