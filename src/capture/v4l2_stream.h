/* v4l2_stream.h - the buffers of a V4L2 node that streams. */
#ifndef SF_CAPTURE_V4L2_STREAM_H
#define SF_CAPTURE_V4L2_STREAM_H

#include "v4l2_device.h"

enum { SF_V4L2_LEAST_BUFFERS = 2, SF_V4L2_MOST_BUFFERS = 32 };

struct sf_v4l2_stream;

/* A frame's memory: the driver's while it is queued, the caller's while it is out, otherwise idle. */
typedef struct sf_v4l2_buffer {
    struct sf_v4l2_stream *stream;
    uint32_t index;
    enum { SF_V4L2_IDLE, SF_V4L2_QUEUED, SF_V4L2_OUT } state;
    uint8_t *memory[SF_FRAME_PLANES]; /* mapped; NULL: no such plane */
    size_t length[SF_FRAME_PLANES];   /* bytes */
    int dmabuf;                       /* -1: none */
} sf_v4l2_buffer;

typedef struct sf_v4l2_stream {
    sf_v4l2_device device;
    sf_v4l2_picture picture;
    double exposure_s, gain; /* as sf_v4l2_set_controls reads them */
    sf_v4l2_buffer buffers[SF_V4L2_MOST_BUFFERS];
    uint32_t count;
    int broken;                  /* it must be stopped and started again */
    struct sf_v4l2_stream *next; /* in a list of closed streams whose frames are still out */
} sf_v4l2_stream;

/* Sets an open device up as `settings` say, maps its buffers and starts it. The device belongs to the stream,
 * also after a failure, when it is closed. Errors as of sf_v4l2_set_picture and sf_v4l2_set_controls;
 * SF_ERR_UNSUPPORTED: fewer than SF_V4L2_LEAST_BUFFERS buffers, or too small ones; SF_ERR_IO;
 * SF_ERR_MEMORY. */
sf_status sf_v4l2_stream_open(const sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              sf_v4l2_stream **stream);

/* Closes the device and unmaps all buffers that are not out: one that is stays readable. */
void sf_v4l2_stream_close(sf_v4l2_stream *stream);
/* Whether frames are out. Where none is, and it is closed, sf_v4l2_stream_free. */
int sf_v4l2_stream_is_out(const sf_v4l2_stream *stream);
void sf_v4l2_stream_free(sf_v4l2_stream *stream);

/* Stops it; what was queued is idle, what is out stays out. */
void sf_v4l2_stream_stop(sf_v4l2_stream *stream);
/* Queues what is idle and starts it. */
sf_status sf_v4l2_stream_start(sf_v4l2_stream *stream);

/* Gives idle buffers to the driver, patiently or not; sets `broken` where a patient try fails. */
void sf_v4l2_stream_queue(sf_v4l2_stream *stream, int patient);
/* Takes a buffer back from the caller. */
void sf_v4l2_stream_give_back(sf_v4l2_buffer *buffer);

/* Waits for an event: 1, or 0 after timeout_ms or an interruption. */
int sf_v4l2_stream_wait(sf_v4l2_stream *stream, int timeout_ms);

/* What came with a frame. */
typedef struct sf_v4l2_arrival {
    sf_v4l2_buffer *buffer;
    uint32_t sequence;
    int64_t time_ns;                       /* monotonic clock */
    const uint8_t *start[SF_FRAME_PLANES]; /* of each plane of memory, past its data_offset */
    size_t bytes[SF_FRAME_PLANES];         /* from there on */
    int damaged;                           /* marked by the driver, too short, or a JPEG that is cut off */
} sf_v4l2_arrival;

/* Takes a frame that has arrived; its buffer is out. 0: there is none, or an error, which sets `broken` or
 * device.gone. */
int sf_v4l2_stream_take(sf_v4l2_stream *stream, sf_v4l2_arrival *arrival);

#endif
