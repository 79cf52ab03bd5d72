/* v4l2_device.h - a V4L2 node: how it is called, what it is, offers and is set to.
 *
 * All calls of the system go through a small table, so that every fault can be played without a camera.
 */
#ifndef SF_CAPTURE_V4L2_DEVICE_H
#define SF_CAPTURE_V4L2_DEVICE_H

#include <linux/videodev2.h>

#include "source_ops.h"

/* The system. Calls give -1 (map: NULL) and set errno where they fail. */
typedef struct sf_v4l2_sys {
    void *user; /* the first argument of each */
    /* Opens a node to read and write, not blocking. */
    int (*open)(void *user, const char *path);
    int (*close)(void *user, int fd);
    int (*ioctl)(void *user, int fd, unsigned long request, void *arg);
    /* Waits for a frame: 1 and *events (POLLIN, POLLERR, ...), 0 when timeout_ms are over. */
    int (*poll)(void *user, int fd, int timeout_ms, int *events);
    void *(*map)(void *user, int fd, size_t offset, size_t length);
    int (*unmap)(void *user, void *memory, size_t length);
    /* Puts at most `most` N of the nodes /dev/videoN into `numbers`, lowest first; returns how many. */
    size_t (*list)(void *user, int *numbers, size_t most);
    /* The serial number of the camera ("": it has none), and which of the camera's nodes this is. */
    void (*identify)(void *user, int fd, char *serial, size_t size, int *index);
    int64_t (*now_ns)(void *user); /* monotonic clock */
    void (*sleep_ms)(void *user, int ms);
} sf_v4l2_sys;

/* The operating system's own. */
extern const sf_v4l2_sys sf_v4l2_system;

enum { SF_V4L2_MOST_NODES = 256, SF_V4L2_PATH = 256 };

typedef struct sf_v4l2_device {
    sf_context *ctx;
    const sf_v4l2_sys *sys;
    int fd;
    int gone;      /* a call was answered that there is no such device any more */
    uint32_t type; /* V4L2_BUF_TYPE_VIDEO_CAPTURE or _MPLANE */
    char path[SF_V4L2_PATH];
    char card[33], bus[33], serial[64];
    int index; /* of the nodes of one camera */
} sf_v4l2_device;

/* What was asked for; reopening asks for it again. */
typedef struct sf_v4l2_settings {
    char path[SF_V4L2_PATH];
    int32_t width, height; /* px; 0: the driver's choice */
    char format[16];       /* a name of ours or a fourcc; "": the best */
    double fps;            /* 0: the driver's choice */
    uint32_t buffers;
    int dmabuf;
    int input;                         /* -1: as it is */
    char timings[16];                  /* "WxH", "auto"; "": as they are */
    char exposure[32], gain[32];       /* "auto", "N", "manual:N"; "": as it is */
    char white_balance[32], focus[32]; /* the same */
    const char *options;               /* the source's name, for its options "ctrl.NAME=VALUE" */
    int32_t fixed_width, fixed_height; /* px; what the camera gave when it was opened first; 0: not yet */
    uint32_t fixed_fourcc;
} sf_v4l2_settings;

/* Opens a node and finds out what it is. SF_ERR_IO: cannot be opened (named, with what helps);
 * SF_ERR_UNSUPPORTED: does not capture. Close it only after SF_OK. */
sf_status sf_v4l2_device_open(sf_context *ctx, const sf_v4l2_sys *sys, const char *path,
                              sf_v4l2_device *device);
void sf_v4l2_device_close(sf_v4l2_device *device);

/* ioctl, again after EINTR; notes where the device is gone. 0, or -1 with errno. */
int sf_v4l2_ioctl(sf_v4l2_device *device, unsigned long request, void *arg);

/* The same for calls that drivers refuse for a moment: after EINVAL, EIO and EAGAIN tried again, up to
 * SF_V4L2_TRIES times with 5, 10, 20 ms between them. */
enum { SF_V4L2_TRIES = 4 };
int sf_v4l2_ioctl_again(sf_v4l2_device *device, unsigned long request, void *arg);

/* Fails with "PATH: what: the words for errno"; SF_ERR_IO. */
sf_status sf_v4l2_fail(const sf_v4l2_device *device, const char *what);

/* Whether the device still answers. */
int sf_v4l2_device_answers(sf_v4l2_device *device);

/* Reads "WxH". 0: it is none. */
int sf_v4l2_parse_size(const char *text, int32_t *width, int32_t *height);

/* ---- formats: v4l2_format.c ---- */

/* A format of memory. */
typedef struct sf_v4l2_pixels {
    uint32_t fourcc;
    sf_pixel_format format;
    uint32_t planes;  /* of memory: 1 where those of the picture lie together */
    const char *name; /* beside the fourcc and ours; NULL: none */
} sf_v4l2_pixels;

/* NULL: splatfit does not read it. */
const sf_v4l2_pixels *sf_v4l2_pixels_of(uint32_t fourcc);

/* How a frame lies in memory. */
typedef struct sf_v4l2_picture {
    const sf_v4l2_pixels *pixels;
    int32_t width, height; /* px */
    double fps;            /* 0: unknown */
    sf_yuv_matrix matrix;
    int full_range, limited_rgb;
    uint32_t planes; /* of the picture */
    struct {
        uint32_t memory; /* which plane of memory */
        size_t offset;   /* of the first row in it */
        size_t stride;   /* bytes */
    } plane[SF_FRAME_PLANES];
    size_t need[SF_FRAME_PLANES]; /* least bytes of each plane of memory */
} sf_v4l2_picture;

/* Chooses input, timings, format, size and rate as `settings` say and sets them. SF_ERR_UNSUPPORTED: not
 * offered; SF_ERR_ARGUMENT: no such format; SF_ERR_IO. */
sf_status sf_v4l2_set_picture(sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              sf_v4l2_picture *picture);

/* Calls `fn` for each format, size and range of rates that the device offers, until it returns not SF_OK,
 * which is returned. A size is 0x0 where the driver does not list sizes. */
typedef sf_status (*sf_v4l2_mode_fn)(void *user, const sf_device_mode *mode);
sf_status sf_v4l2_each_mode(sf_v4l2_device *device, sf_v4l2_mode_fn fn, void *user);

/* ---- inputs: v4l2_input.c ---- */

/* Set what `settings` name. SF_ERR_UNSUPPORTED: not offered; SF_ERR_ARGUMENT: timings that are none;
 * SF_ERR_IO. */
sf_status sf_v4l2_set_input(sf_v4l2_device *device, const sf_v4l2_settings *settings);
sf_status sf_v4l2_set_timings(sf_v4l2_device *device, const sf_v4l2_settings *settings);

/* Why the input carries no picture ("no signal"); NULL: it does, or does not say. */
const char *sf_v4l2_signal(sf_v4l2_device *device);

/* ---- controls: v4l2_controls.c ---- */

/* Sets what `settings` name and reads what the frames' exposure (s) and gain (driver's units) are: 0 where
 * the camera chooses by itself or does not tell. SF_ERR_UNSUPPORTED: no such control; SF_ERR_ARGUMENT: out of
 * range; SF_ERR_IO. */
sf_status sf_v4l2_set_controls(sf_v4l2_device *device, const sf_v4l2_settings *settings, double *exposure_s,
                               double *gain);

/* Whether the camera chooses exposure, gain or white balance by itself where it is let. */
int sf_v4l2_has_automatic(sf_v4l2_device *device);
/* locked 1: it chooses none of them any more, and each stays as it is; *were: which it did choose. 0: it
 * chooses these again. SF_ERR_IO. */
sf_status sf_v4l2_lock(sf_v4l2_device *device, int locked, unsigned *were);

#endif
