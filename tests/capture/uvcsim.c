/* uvcsim.c - a simulated USB webcam: a program that the kernel's uvcvideo driver takes for a camera.
 *
 * Its frames are the numbered patterns of pattern.h, as MJPEG and as YUYV. Needs the modules vhci-hcd and
 * uvcvideo, and root. Prints each control that the host sets, and what becomes of the camera.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "pattern.h"
#include "uvc.h"

enum { HEAD = 12 }; /* bytes before each payload */

/* Every nth frame suffers; 0: none does. */
typedef struct faults {
    uint32_t mark; /* as damaged, in its payloads' heads */
    uint32_t lose; /* its first payload */
    uint32_t cut;  /* to half */
} faults;

typedef struct simulation {
    uvc_camera camera;
    usb_device usb;
    faults faults;
    uint32_t unplug_after; /* frames streamed; 0: never */
    int replug_ms;         /* how long it stays away; -1: for good */

    uint32_t id;            /* of the frame on its way, or the next */
    uint32_t streamed;      /* frames since it was plugged in */
    int sending;            /* a frame is on its way */
    int toggle;             /* changes with each frame */
    size_t sent, bytes;     /* of it */
    double due;             /* when the next one begins, s */
    int committed, stopped; /* of the camera, as seen last */
    uint8_t *yuyv, *jpeg;
    size_t jpeg_bytes, capacity;
} simulation;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* 1. Frames */

static int make_frames(simulation *s) {
    s->capacity = (size_t)s->camera.width * (size_t)s->camera.height * 2;
    s->yuyv = malloc(s->capacity);
    s->jpeg = malloc(s->capacity);
    return s->yuyv && s->jpeg &&
           pattern_jpeg(s->jpeg, s->capacity, s->camera.width, s->camera.height, 0, &s->jpeg_bytes);
}

static int happens(uint32_t every, uint32_t id) { return every && id % every == every - 1; }

static void begin_frame(simulation *s) {
    if (s->camera.format == UVC_MJPEG) {
        pattern_mark_jpeg(s->jpeg, s->jpeg_bytes, s->id);
        s->bytes = s->jpeg_bytes;
    } else {
        pattern_plane planes[SF_FRAME_PLANES] = {{.data = s->yuyv, .stride = 2 * (size_t)s->camera.width}};
        pattern_planes(SF_PIXEL_YUYV, s->camera.width, s->camera.height, planes);
        pattern_fill(planes, 1, s->id);
        s->bytes = s->capacity;
    }
    if (happens(s->faults.cut, s->id)) s->bytes /= 2;
    s->sent = 0;
    s->sending = 1;
    s->toggle ^= 1;
}

static void put_time(uint8_t *to) {
    uint32_t ticks = (uint32_t)(uint64_t)(now() * 48e6);
    for (int i = 0; i < 4; i++) to[i] = (uint8_t)(ticks >> 8 * i);
}

static void end_frame(simulation *s) {
    s->sending = 0;
    s->id++;
    s->streamed++;
}

/* One transfer: a head, and as much of the frame as goes in. */
static void send_payload(simulation *s) {
    enum { TOGGLE = 1, END = 2, HAS_TIME = 4, HAS_CLOCK = 8, DAMAGED = 0x40, HEAD_ENDS = 0x80 };
    uint8_t payload[UVC_PAYLOAD] = {HEAD};
    size_t bytes = s->bytes - s->sent < UVC_PAYLOAD - HEAD ? s->bytes - s->sent : UVC_PAYLOAD - HEAD;
    int first = s->sent == 0, last = s->sent + bytes == s->bytes;
    payload[1] = (uint8_t)(HEAD_ENDS | HAS_TIME | HAS_CLOCK | (s->toggle ? TOGGLE : 0) | (last ? END : 0) |
                           (happens(s->faults.mark, s->id) ? DAMAGED : 0));
    put_time(payload + 2);
    put_time(payload + 6);
    memcpy(payload + HEAD, (s->camera.format == UVC_MJPEG ? s->jpeg : s->yuyv) + s->sent, bytes);
    s->sent += bytes;
    if (!(first && happens(s->faults.lose, s->id))) usb_send(&s->usb, payload, HEAD + bytes);
    if (last) end_frame(s);
}

/* Answers the host's waiting requests as far as frames are due. */
static void stream(simulation *s) {
    while (s->usb.waiting_count > 0) {
        if (!s->sending) {
            double t = now();
            if (t < s->due) return;
            /* A host that did not ask for a second is not sent what it missed. */
            s->due = (s->due < t - 1 ? t : s->due) + 1.0 / s->camera.fps;
            begin_frame(s);
        }
        send_payload(s);
    }
}

/* 2. The camera's life */

/* A stream that was stopped, or begun anew, begins with a whole frame. */
static void notice_host(simulation *s) {
    if (s->camera.stopped != s->stopped) s->usb.waiting_count = 0;
    if (s->camera.stopped != s->stopped || s->camera.committed != s->committed) s->sending = 0;
    s->stopped = s->camera.stopped;
    s->committed = s->camera.committed;
}

static int wait_ms(const simulation *s) {
    if (s->usb.waiting_count == 0) return 1000;
    double wait = s->due - now();
    return wait <= 0 ? 0 : (int)(wait * 1000) + 1;
}

/* Serves the host until it lets go of the camera (0) or the camera is to be unplugged (1). */
static int run_plugged(simulation *s) {
    s->streamed = 0;
    s->sending = 0;
    s->due = 0;
    while (usb_serve(&s->usb, wait_ms(s), uvc_answer, &s->camera)) {
        notice_host(s);
        stream(s);
        if (s->unplug_after && s->streamed >= s->unplug_after) return 1;
    }
    return 0;
}

static void say(const char *word) {
    puts(word);
    fflush(stdout);
}

static int run(simulation *s) {
    for (;;) {
        if (!usb_plug(&s->usb)) {
            fputs("uvcsim: cannot be plugged in: is vhci-hcd loaded, is its port 0 free?\n", stderr);
            return 1;
        }
        say("plugged in");
        int unplug = run_plugged(s);
        usb_unplug(&s->usb);
        say("unplugged");
        if (!unplug || s->replug_ms < 0) return 0;
        struct timespec away = {s->replug_ms / 1000, s->replug_ms % 1000 * 1000000L};
        nanosleep(&away, NULL);
        s->unplug_after = 0;
    }
}

/* 3. The command line */

static int usage(void) {
    fputs("usage: uvcsim [-s WIDTHxHEIGHT] [-r FPS] [-n SERIAL] [-e N] [-d N] [-t N] [-u FRAMES] [-p MS]\n"
          "  -e N       every Nth frame is marked as damaged\n"
          "  -d N       every Nth frame lacks its first payload\n"
          "  -t N       every Nth frame is cut to half\n"
          "  -u FRAMES  is unplugged after that many\n"
          "  -m MODES   of exposure, a sum: 1 by hand, 2 automatic, 8 automatic with a fixed aperture; 3\n"
          "  -p MS      and plugged in again after that time\n",
          stderr);
    return 2;
}

int main(int argc, char **argv) {
    simulation s = {.replug_ms = -1};
    int width = 640, height = 480, fps = 30, modes = 3, option;
    const char *serial = "0001";
    while ((option = getopt(argc, argv, "s:r:n:e:d:t:u:p:m:")) != -1) {
        uint32_t number = (uint32_t)(optarg ? strtoul(optarg, NULL, 10) : 0);
        switch (option) {
        case 's':
            if (sscanf(optarg, "%dx%d", &width, &height) != 2) return usage();
            break;
        case 'r':
            fps = (int)number;
            break;
        case 'n':
            serial = optarg;
            break;
        case 'e':
            s.faults.mark = number;
            break;
        case 'd':
            s.faults.lose = number;
            break;
        case 't':
            s.faults.cut = number;
            break;
        case 'u':
            s.unplug_after = number;
            break;
        case 'p':
            s.replug_ms = (int)number;
            break;
        case 'm':
            modes = (int)number;
            break;
        default:
            return usage();
        }
    }
    if (width < 16 || height < 16 || fps < 1) return usage();
    uvc_init(&s.camera, width, height, fps, serial);
    uvc_exposure_modes(&s.camera, modes);
    if (!make_frames(&s)) {
        fputs("uvcsim: out of memory\n", stderr);
        return 1;
    }
    return run(&s);
}
