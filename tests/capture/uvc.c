/* uvc.c - descriptors and control requests of a simulated webcam. */
#include "uvc.h"

#include <stdio.h>
#include <string.h>

enum { CAMERA_UNIT = 1, PROCESSING_UNIT = 2, OUTPUT_UNIT = 3 };
enum { CONTROL_INTERFACE = 0, STREAMING_INTERFACE = 1 };
enum { CLOCK_HZ = 48000000 };
enum { PROBE_BYTES = 34 };

void uvc_init(uvc_camera *camera, int width, int height, int fps, const char *serial) {
    static const uvc_control controls[UVC_CONTROLS] = {
        /* Of the mode, `step` is the set of modes: by hand, automatic. */
        {"exposure mode", CAMERA_UNIT, 2, 1, 1, 8, 3, 2, 2},
        {"exposure", CAMERA_UNIT, 4, 4, 1, 10000, 1, 333, 333}, /* 100 us */
        {"brightness", PROCESSING_UNIT, 2, 2, 0, 255, 1, 100, 100},
        {"gain", PROCESSING_UNIT, 4, 2, 0, 255, 1, 16, 16}};
    *camera =
        (uvc_camera){.width = width, .height = height, .fps = fps, .serial = serial, .format = UVC_MJPEG};
    memcpy(camera->controls, controls, sizeof controls);
}

void uvc_exposure_modes(uvc_camera *camera, int modes) {
    uvc_control *mode = &camera->controls[0];
    mode->step = modes;
    mode->standard = mode->now = modes & 8 ? 8 : modes & 2 ? 2 : 1;
}

/* 1. Descriptors */

typedef struct writer {
    uint8_t *data;
    int bytes;
} writer;

#define LE16(v) (uint8_t)(v), (uint8_t)((v) >> 8)
#define LE32(v) (uint8_t)(v), (uint8_t)((v) >> 8), (uint8_t)((v) >> 16), (uint8_t)((v) >> 24)

/* Each descriptor begins with its length, which is filled in here. */
#define PUT(writer, ...)                                                                                     \
    put(writer, (const uint8_t[]){0, __VA_ARGS__}, (int)sizeof(uint8_t[]){0, __VA_ARGS__})

static void put(writer *w, const uint8_t *descriptor, int bytes) {
    memcpy(w->data + w->bytes, descriptor, (size_t)bytes);
    w->data[w->bytes] = (uint8_t)bytes;
    w->bytes += bytes;
}

static void set16(uint8_t *to, int v) {
    to[0] = (uint8_t)v;
    to[1] = (uint8_t)(v >> 8);
}

enum { DEVICE = 1, CONFIGURATION = 2, STRING = 3, INTERFACE = 4, ENDPOINT = 5, ASSOCIATION = 11 };
enum { CLASS_VIDEO = 0x0E, SUBCLASS_CONTROL = 1, SUBCLASS_STREAMING = 2, SUBCLASS_COLLECTION = 3 };
enum { CS_INTERFACE = 0x24 };

static int device_descriptor(uint8_t *in) {
    writer w = {in, 0};
    PUT(&w, DEVICE, LE16(0x0200), 0xEF, 2, 1, 64, LE16(0x1D6B), LE16(0x0102), LE16(0x0100), 1, 2, 3, 1);
    return w.bytes;
}

static void put_control_interface(writer *w) {
    PUT(w, INTERFACE, CONTROL_INTERFACE, 0, 0, CLASS_VIDEO, SUBCLASS_CONTROL, 0, 0);
    int head = w->bytes;
    PUT(w, CS_INTERFACE, 1, LE16(0x0110), LE16(0), LE32(CLOCK_HZ), 1, STREAMING_INTERFACE);
    /* A camera with an exposure mode and time, brightness and gain behind it, and an output. */
    PUT(w, CS_INTERFACE, 2, CAMERA_UNIT, LE16(0x0201), 0, 0, LE16(0), LE16(0), LE16(0), 3, 0x0A, 0, 0);
    PUT(w, CS_INTERFACE, 5, PROCESSING_UNIT, CAMERA_UNIT, LE16(0), 2, LE16(0x0201), 0, 0);
    PUT(w, CS_INTERFACE, 3, OUTPUT_UNIT, LE16(0x0101), 0, PROCESSING_UNIT, 0);
    set16(w->data + head + 5, w->bytes - head);
}

/* The one size and rate of a format; `kind` says of which sort of format. */
static void put_frame(const uvc_camera *camera, writer *w, int kind) {
    uint32_t bytes = (uint32_t)(camera->width * camera->height * 2), bits = bytes * 8;
    uint32_t interval = 10000000U / (uint32_t)camera->fps;
    PUT(w, CS_INTERFACE, (uint8_t)kind, 1, 0, LE16(camera->width), LE16(camera->height), LE32(bits),
        LE32(bits * (uint32_t)camera->fps), LE32(bytes), LE32(interval), 1, LE32(interval));
    PUT(w, CS_INTERFACE, 0x0D, 1, 1, 4); /* BT.709 primaries and transfer, BT.601 matrix */
}

static void put_streaming_interface(const uvc_camera *camera, writer *w) {
    enum { FORMAT_UNCOMPRESSED = 4, FRAME_UNCOMPRESSED = 5, FORMAT_MJPEG = 6, FRAME_MJPEG = 7 };
    PUT(w, INTERFACE, STREAMING_INTERFACE, 0, 1, CLASS_VIDEO, SUBCLASS_STREAMING, 0, 0);
    int head = w->bytes;
    PUT(w, CS_INTERFACE, 1, 2, LE16(0), 0x81, 0, OUTPUT_UNIT, 0, 0, 0, 1, 0, 0);
    PUT(w, CS_INTERFACE, FORMAT_MJPEG, UVC_MJPEG, 1, 1, 1, 0, 0, 0, 0);
    put_frame(camera, w, FRAME_MJPEG);
    PUT(w, CS_INTERFACE, FORMAT_UNCOMPRESSED, UVC_YUYV, 1, 'Y', 'U', 'Y', '2', 0, 0, 0x10, 0, 0x80, 0, 0,
        0xAA, 0, 0x38, 0x9B, 0x71, 16, 1, 0, 0, 0, 0);
    put_frame(camera, w, FRAME_UNCOMPRESSED);
    set16(w->data + head + 4, w->bytes - head);
    PUT(w, ENDPOINT, 0x81, 2, LE16(512), 0); /* bulk */
}

static int configuration_descriptor(const uvc_camera *camera, uint8_t *in) {
    writer w = {in, 0};
    PUT(&w, CONFIGURATION, LE16(0), 2, 1, 0, 0x80, 250);
    PUT(&w, ASSOCIATION, 0, 2, CLASS_VIDEO, SUBCLASS_COLLECTION, 0, 0);
    put_control_interface(&w);
    put_streaming_interface(camera, &w);
    set16(in + 2, w.bytes);
    return w.bytes;
}

/* String `index` in UTF-16; string 0 says that they are in English. */
static int string_descriptor(const uvc_camera *camera, int index, uint8_t *in) {
    const char *text[] = {NULL, "splatfit", "Simulated webcam", camera->serial};
    if (index > 3) return -1;
    writer w = {in, 0};
    PUT(&w, STRING, LE16(0x0409));
    if (index == 0) return w.bytes;
    w.bytes = 2;
    for (const char *c = text[index]; *c; c++) {
        set16(in + w.bytes, *c);
        w.bytes += 2;
    }
    in[0] = (uint8_t)w.bytes;
    return w.bytes;
}

static int descriptor(const uvc_camera *camera, int kind, int index, uint8_t *in) {
    if (kind == DEVICE) return device_descriptor(in);
    if (kind == CONFIGURATION) return configuration_descriptor(camera, in);
    if (kind == STRING) return string_descriptor(camera, index, in);
    return -1;
}

/* 2. Requests of the video class */

enum { SET_CUR = 1, GET_CUR = 0x81, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF };

static int32_t get_value(const uint8_t *data, int bytes) {
    int32_t value = 0;
    for (int i = 0; i < bytes; i++) value |= (int32_t)((uint32_t)data[i] << 8 * i);
    return value;
}

static int put_value(uint8_t *in, int32_t value, int bytes) {
    for (int i = 0; i < bytes; i++) in[i] = (uint8_t)((uint32_t)value >> 8 * i);
    return bytes;
}

static int answer_control(uvc_control *control, const usb_setup *setup, const uint8_t *out, uint8_t *in) {
    switch (setup->request) {
    case SET_CUR:
        control->now = get_value(out, control->bytes);
        printf("%s %d\n", control->name, control->now);
        fflush(stdout);
        return 0;
    case GET_CUR:
        return put_value(in, control->now, control->bytes);
    case GET_MIN:
        return put_value(in, control->least, control->bytes);
    case GET_MAX:
        return put_value(in, control->most, control->bytes);
    case GET_RES:
        return put_value(in, control->step, control->bytes);
    case GET_DEF:
        return put_value(in, control->standard, control->bytes);
    case GET_LEN:
        return put_value(in, control->bytes, 2);
    case GET_INFO:
        return put_value(in, 3, 1); /* can be read and set */
    }
    return -1;
}

/* What is, or would be, streamed. */
static int put_probe(const uvc_camera *camera, uint8_t *in) {
    memset(in, 0, PROBE_BYTES);
    in[0] = 1;
    in[2] = (uint8_t)camera->format;
    in[3] = 1;
    put_value(in + 4, 10000000 / camera->fps, 4);
    put_value(in + 18, camera->width * camera->height * 2, 4);
    put_value(in + 22, UVC_PAYLOAD, 4);
    put_value(in + 26, CLOCK_HZ, 4);
    in[30] = 3;                   /* a frame's end and its changing bit are marked */
    in[31] = in[32] = in[33] = 1; /* versions of the payload */
    return PROBE_BYTES;
}

static int answer_stream(uvc_camera *camera, const usb_setup *setup, const uint8_t *out, uint8_t *in) {
    enum { COMMIT = 2 };
    switch (setup->request) {
    case SET_CUR:
        if (out[2] == UVC_MJPEG || out[2] == UVC_YUYV) camera->format = out[2];
        if (setup->value >> 8 == COMMIT) camera->committed++;
        return 0;
    case GET_LEN:
        return put_value(in, PROBE_BYTES, 2);
    case GET_INFO:
        return put_value(in, 3, 1);
    }
    return put_probe(camera, in);
}

static int answer_class(uvc_camera *camera, const usb_setup *setup, const uint8_t *out, uint8_t *in) {
    int unit = setup->index >> 8, selector = setup->value >> 8;
    if ((setup->index & 0xFF) == STREAMING_INTERFACE) return answer_stream(camera, setup, out, in);
    if (unit == 0) return put_value(in, 0, 1); /* what went wrong last: nothing */
    for (int i = 0; i < UVC_CONTROLS; i++)
        if (camera->controls[i].unit == unit && camera->controls[i].selector == selector)
            return answer_control(&camera->controls[i], setup, out, in);
    return -1;
}

int uvc_answer(void *user, const usb_setup *setup, const uint8_t *out, uint8_t *in) {
    uvc_camera *camera = user;
    switch (setup->type << 8 | setup->request) {
    case 0x8006:
        return descriptor(camera, setup->value >> 8, setup->value & 0xFF, in);
    case 0x0009:
        return 0; /* this configuration */
    case 0x010B:
        return 0; /* this setting of an interface */
    case 0x0201:  /* the endpoint is no longer halted: how a bulk stream is stopped */
        camera->stopped++;
        return 0;
    case 0x8000: /* status of the device, an interface, an endpoint */
    case 0x8100:
    case 0x8200:
        return put_value(in, 0, 2);
    }
    return setup->type == 0x21 || setup->type == 0xA1 ? answer_class(camera, setup, out, in) : -1;
}
