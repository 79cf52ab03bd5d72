/* uvc.h - what a USB webcam (video class 1.1) says of itself, and its controls. */
#ifndef UVC_H
#define UVC_H

#include "usb.h"

enum { UVC_MJPEG = 1, UVC_YUYV = 2 }; /* numbers of its formats */
enum { UVC_PAYLOAD = 16384 };         /* most bytes of one transfer: what uvcvideo asks for */

typedef struct uvc_control {
    const char *name;
    uint8_t unit, selector, bytes;
    int32_t least, most, step, standard, now;
} uvc_control;

enum { UVC_CONTROLS = 4 };

typedef struct uvc_camera {
    int width, height, fps;
    const char *serial;
    uvc_control controls[UVC_CONTROLS];
    int format;
    int committed; /* counts how often the host chose what to stream */
    int stopped;   /* counts how often it stopped the stream */
} uvc_camera;

void uvc_init(uvc_camera *camera, int width, int height, int fps, const char *serial);

/* The exposure modes that it has: 1 by hand, 2 automatic, 8 automatic with a fixed aperture, as most webcams.
 */
void uvc_exposure_modes(uvc_camera *camera, int modes);

/* usb_answer of a uvc_camera: prints each control that is set on standard output. */
int uvc_answer(void *camera, const usb_setup *setup, const uint8_t *out, uint8_t *in);

#endif
