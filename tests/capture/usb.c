/* usb.c - speaks USB/IP with the kernel's virtual host controller. */
#include "usb.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

/* Messages of the protocol, 48 bytes each, numbers big-endian. */
enum { SUBMIT = 1, UNLINK = 2, SUBMITTED = 3, UNLINKED = 4 };
enum { FROM_DEVICE = 1 };
enum { ANSWER_MOST = 4096 };

typedef struct message {
    uint32_t command, number, device, direction, endpoint;
    union {
        struct {
            uint32_t flags, length, start, packets, interval;
            uint8_t setup[8];
        } submit;
        struct {
            uint32_t status, length, start, packets, errors;
            uint8_t padding[8];
        } submitted;
        uint32_t unlink; /* number of the request to forget */
        uint32_t status;
    };
} message;

_Static_assert(sizeof(message) == 48, "a message has 48 bytes");

static int read_all(int fd, void *to, size_t bytes) {
    uint8_t *next = to;
    while (bytes > 0) {
        ssize_t got = read(fd, next, bytes);
        if (got <= 0) return 0;
        next += got;
        bytes -= (size_t)got;
    }
    return 1;
}

static void write_all(int fd, const void *from, size_t bytes) {
    const uint8_t *next = from;
    while (bytes > 0) {
        ssize_t sent = send(fd, next, bytes, MSG_NOSIGNAL);
        if (sent <= 0) return; /* the next read says that the host is gone */
        next += sent;
        bytes -= (size_t)sent;
    }
}

/* Gives the kernel one end of a socket for port 0 at high speed. */
static int attach(int socket) {
    enum { HIGH_SPEED = 3, DEVICE_ID = 0x10002 };
    char text[64];
    int length = snprintf(text, sizeof text, "0 %d %d %d", socket, DEVICE_ID, HIGH_SPEED);
    int fd = open("/sys/devices/platform/vhci_hcd.0/attach", O_WRONLY | O_CLOEXEC);
    int attached = fd >= 0 && write(fd, text, (size_t)length) == length;
    if (fd >= 0) close(fd);
    return attached;
}

int usb_plug(usb_device *device) {
    int ends[2], attached = 0;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return 0;
    for (int i = 0; i < 50 && !attached; i++) {
        attached = attach(ends[1]);
        if (!attached) nanosleep(&(struct timespec){0, 100000000}, NULL);
    }
    close(ends[1]);
    device->socket = ends[0];
    device->waiting_count = 0;
    if (!attached) close(ends[0]);
    return attached;
}

void usb_unplug(usb_device *device) {
    shutdown(device->socket, SHUT_RDWR);
    close(device->socket);
}

static void answer_submit(usb_device *device, uint32_t number, int status, const uint8_t *data, size_t bytes,
                          size_t done) {
    message m = {.command = htonl(SUBMITTED), .number = htonl(number)};
    m.submitted.status = htonl((uint32_t)status);
    m.submitted.length = htonl((uint32_t)done);
    write_all(device->socket, &m, sizeof m);
    write_all(device->socket, data, bytes);
}

static void forget_waiting(usb_device *device, int index) {
    device->waiting_count--;
    memmove(device->waiting + index, device->waiting + index + 1,
            (size_t)(device->waiting_count - index) * sizeof *device->waiting);
}

static void unlink_request(usb_device *device, uint32_t number, uint32_t forgotten) {
    message m = {.command = htonl(UNLINKED), .number = htonl(number)};
    for (int i = 0; i < device->waiting_count; i++)
        if (device->waiting[i] == forgotten) {
            forget_waiting(device, i);
            m.status = htonl((uint32_t)-ECONNRESET);
            break;
        }
    write_all(device->socket, &m, sizeof m);
}

static void answer_setup(usb_device *device, const message *m, const uint8_t *out, size_t out_bytes,
                         usb_answer answer, void *user) {
    const uint8_t *raw = m->submit.setup;
    uint32_t number = ntohl(m->number);
    int in = ntohl(m->direction) == FROM_DEVICE;
    usb_setup setup = {raw[0], raw[1], (uint16_t)(raw[2] | raw[3] << 8), (uint16_t)(raw[4] | raw[5] << 8),
                       (uint16_t)(raw[6] | raw[7] << 8)};
    uint8_t data[ANSWER_MOST] = {0};
    int bytes = answer(user, &setup, out, data);
    if (bytes > setup.length) bytes = setup.length;
    if (bytes < 0)
        answer_submit(device, number, -EPIPE, NULL, 0, 0);
    else
        answer_submit(device, number, 0, data, in ? (size_t)bytes : 0, in ? (size_t)bytes : out_bytes);
}

static int serve_submit(usb_device *device, const message *m, usb_answer answer, void *user) {
    static uint8_t out[65536];
    uint32_t number = ntohl(m->number), length = ntohl(m->submit.length);
    int in = ntohl(m->direction) == FROM_DEVICE;
    size_t out_bytes = in ? 0 : length;
    if (out_bytes > sizeof out || !read_all(device->socket, out, out_bytes)) return 0;
    if (ntohl(m->endpoint) == 0)
        answer_setup(device, m, out, out_bytes, answer, user);
    else if (in && device->waiting_count < USB_WAITING_MOST)
        device->waiting[device->waiting_count++] = number;
    else
        answer_submit(device, number, -EPIPE, NULL, 0, 0);
    return 1;
}

int usb_serve(usb_device *device, int timeout_ms, usb_answer answer, void *user) {
    struct pollfd ready = {device->socket, POLLIN, 0};
    if (poll(&ready, 1, timeout_ms) <= 0) return 1;
    message m;
    if (!read_all(device->socket, &m, sizeof m)) return 0;
    if (ntohl(m.command) == SUBMIT) return serve_submit(device, &m, answer, user);
    if (ntohl(m.command) == UNLINK) unlink_request(device, ntohl(m.number), ntohl(m.unlink));
    return 1;
}

void usb_send(usb_device *device, const uint8_t *data, size_t bytes) {
    uint32_t number = device->waiting[0];
    forget_waiting(device, 0);
    answer_submit(device, number, 0, data, bytes, bytes);
}
