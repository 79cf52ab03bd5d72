/* source.h - frames from a camera, a file, a pipe or a simulation, one interface for all.
 *
 * A source is opened by a name, SCHEME:WHICH?option=value&option=value:
 *     v4l2:/dev/video0?size=640x480&format=YUYV&fps=30&exposure=manual:120
 *     libcamera:0?size=1280x720          folder:DIR          video:FILE          pipe:-
 *     sim:studio?width=320&height=240&frames=60&seed=1          sim:studio-board
 * The path of a folder or a video is a name, too. src/capture/README.md lists the options of each,
 * src/sim/README.md those of sim:.
 */
#ifndef SPLATFIT_SOURCE_H
#define SPLATFIT_SOURCE_H

#include <stdint.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where frames come from. One thread at a time may use it. */
typedef struct sf_source sf_source;

/* How the pixels of a frame lie in memory. Names of four letters are V4L2's; the planes of one format may lie
 * together or apart. Chroma is shared by the pixels that it covers. */
typedef enum sf_pixel_format {
    SF_PIXEL_RGB24,  /* 3 bytes a pixel: R, G, B */
    SF_PIXEL_BGR24,  /* B, G, R */
    SF_PIXEL_GREY,   /* 1 byte a pixel: Y */
    SF_PIXEL_YUYV,   /* 4 bytes for two pixels: Y U Y V */
    SF_PIXEL_UYVY,   /* U Y V Y */
    SF_PIXEL_NV12,   /* plane 0: Y; plane 1: U V for 2 x 2 pixels (NV12M too) */
    SF_PIXEL_YU12,   /* planes Y, U, V; chroma for 2 x 2 pixels (YM12, I420 too) */
    SF_PIXEL_422P,   /* planes Y, U, V; chroma for 2 x 1 pixels */
    SF_PIXEL_444P,   /* planes Y, U, V of the same size */
    SF_PIXEL_MJPEG,  /* plane 0: one JPEG file of `bytes` bytes */
    SF_PIXEL_FORMATS /* how many there are */
} sf_pixel_format;

/* "RGB24", "YUYV", ...; "MJPEG". NULL: there is no such format. */
SF_API const char *sf_pixel_format_name(sf_pixel_format format);

/* Plane 0..2 of a picture of that size (px) whose rows lie close together: bytes a row, and rows. Both 0: the
 * format has no such plane, or is SF_PIXEL_MJPEG. */
SF_API void sf_pixel_plane(sf_pixel_format format, int32_t width, int32_t height, int plane, size_t *bytes,
                           size_t *rows);

/* How Y, U, V stand for R, G, B (ITU-R BT.601, BT.709, BT.2020); of no meaning to other formats. */
typedef enum sf_yuv_matrix {
    SF_YUV_601, /* BT.601: webcams, JPEG */
    SF_YUV_709, /* BT.709: HDTV */
    SF_YUV_2020 /* BT.2020: UHDTV */
} sf_yuv_matrix;

/* What a source gives. */
typedef struct sf_source_info {
    int32_t width, height;    /* px */
    sf_pixel_format format;   /* of its frames */
    double frames_per_second; /* 0: unknown or not in real time */
    uint64_t frames;          /* 0: without end or unknown */
    int has_poses;            /* frames come with their true camera */
    int live;                 /* frames come in real time: those that nobody takes in time are lost */
    int can_lock_exposure;    /* sf_source_lock_exposure works */
    char name[128];           /* for display */
} sf_source_info;

/* Counts of the frames so far. */
typedef struct sf_source_counts {
    uint64_t given;    /* by sf_source_next and sf_source_newest */
    uint64_t skipped;  /* passed over by sf_source_newest for a newer one */
    uint64_t dropped;  /* lost before they reached the library: gaps in the sequence */
    uint64_t damaged;  /* marked as damaged, cut off or undecodable; not given */
    uint64_t reopened; /* times that the device was unplugged and came back */
} sf_source_counts;

/* The most planes of a frame: SF_FRAME_PLANES. */
enum { SF_FRAME_PLANES = 3 };

/* A frame. Its memory stays valid until sf_source_release, or sf_source_close. */
typedef struct sf_frame {
    const uint8_t *plane[SF_FRAME_PLANES]; /* first rows; NULL: no such plane */
    size_t stride[SF_FRAME_PLANES];        /* bytes a row of each; 0 for SF_PIXEL_MJPEG */
    size_t bytes;                          /* SF_PIXEL_MJPEG: of plane 0; otherwise 0 */
    int32_t width, height;                 /* px */
    sf_pixel_format format;                /* how the planes are laid out */
    sf_yuv_matrix matrix;                  /* of YUV */
    int full_range;          /* YUV: Y 0..255, chroma 1..255 about 128; otherwise 16..235, 16..240 */
    int limited_rgb;         /* RGB24, BGR24: 16..235, as some HDMI inputs give; otherwise 0..255 */
    uint64_t sequence;       /* the source's own count: a gap is a dropped frame */
    int64_t time_ns;         /* when it was taken; the monotonic clock for live sources, from 0 otherwise */
    double exposure_s, gain; /* 0: unknown */
    int dmabuf;              /* V4L2: file descriptor of the memory, the source's own; -1: none */
    int has_camera;          /* the source knows the frame's true camera */
    sf_camera camera;        /* valid if has_camera */
    void *lease;             /* for use by the source alone */
} sf_frame;

/* Opens a source by name. SF_ERR_ARGUMENT: unknown source or option, value out of range (named);
 * SF_ERR_IO: the device or file cannot be opened; SF_ERR_UNSUPPORTED: not built, or the device does not offer
 * a requested setting (the message lists those that it offers); SF_ERR_FORMAT: a pipe or folder whose content
 * is wrong; SF_ERR_EMPTY: a pipe or folder without a frame; SF_ERR_TIMEOUT: a pipe that stays silent. */
SF_API sf_status sf_source_open(sf_context *context, const char *name, sf_source **source);
SF_API void sf_source_close(sf_source **source);
SF_API void sf_source_describe(const sf_source *source, sf_source_info *info);

/* 1: fixes exposure, gain and white balance at their present values; 0: those that were automatic before are
 * automatic again. The simulated camera fixes the exposure alone. Call it from the thread of sf_source_next.
 * SF_ERR_UNSUPPORTED: the source has no such control; SF_ERR_IO: the camera is gone, or refuses. */
SF_API sf_status sf_source_lock_exposure(sf_source *source, int locked);
SF_API void sf_source_count(const sf_source *source, sf_source_counts *counts);

/* Gets the next frame, in order, waiting at most timeout_ms (-1: without a limit, but 10 s on a live source).
 * For recording: no frame is skipped that the source could keep. SF_ERR_TIMEOUT: no frame came, also while an
 * unplugged camera is awaited; try again. SF_ERR_END; SF_ERR_IO: the source has failed, close it. At most two
 * frames may be unreleased at a time (SF_ERR_ARGUMENT). */
SF_API sf_status sf_source_next(sf_source *source, int timeout_ms, sf_frame *frame);

/* The same, but gets the newest waiting frame and skips the others: for tracking. On a source that is not
 * live it is sf_source_next. */
SF_API sf_status sf_source_newest(sf_source *source, int timeout_ms, sf_frame *frame);

/* Gives a frame back. */
SF_API void sf_source_release(sf_source *source, sf_frame *frame);

/* A frame as planes of floats, sRGB values 0..1 as pictures have them: rgb[c] points at height x stride
 * floats, stride >= width; what lies beyond the width is left alone. SF_ERR_FORMAT: an MJPEG that cannot be
 * decoded whole, or whose size is not the frame's. */
SF_API sf_status sf_frame_convert(sf_context *context, const sf_frame *frame, float *const rgb[3],
                                  size_t stride);

/* Cameras of this machine. */
typedef struct sf_devices sf_devices;

/* A camera of this machine. */
typedef struct sf_device_info {
    char source[256]; /* opens it: "v4l2:/dev/video0" */
    char name[64];    /* the driver's name for display */
    char bus[64];     /* the port where it is plugged in; "": unknown */
    char serial[64];  /* "": unknown */
    size_t modes;     /* for sf_devices_get_mode */
} sf_device_info;

/* A format, size and range of rates that a camera offers. */
typedef struct sf_device_mode {
    char fourcc[5];                                           /* the driver's name of the format */
    int supported;                                            /* splatfit reads it */
    sf_pixel_format format;                                   /* where supported */
    int32_t width, height;                                    /* px; the least where a range is offered */
    int32_t width_most, height_most, width_step, height_step; /* width_most 0: this size alone */
    double fps_least, fps_most;                               /* 0: unknown */
} sf_device_mode;

/* Looks for cameras. SF_ERR_MEMORY; no camera is no error. */
SF_API sf_status sf_devices_find(sf_context *context, sf_devices **devices);
SF_API void sf_devices_free(sf_devices **devices);
/* Camera `index`, mode `mode` of it. SF_ERR_END past the last. */
SF_API sf_status sf_devices_get(const sf_devices *devices, size_t index, sf_device_info *info);
SF_API sf_status sf_devices_get_mode(const sf_devices *devices, size_t index, size_t mode,
                                     sf_device_mode *result);

#ifdef __cplusplus
}
#endif
#endif
