/* usb.h - a USB device in user space, plugged into the kernel's virtual host controller (vhci-hcd).
 *
 * The kernel sends requests over a socket, in the protocol of USB/IP; requests of the bulk endpoint are kept
 * until there is something to answer.
 */
#ifndef USB_H
#define USB_H

#include <stddef.h>
#include <stdint.h>

enum { USB_WAITING_MOST = 64 };

typedef struct usb_device {
    int socket;
    uint32_t waiting[USB_WAITING_MOST]; /* numbers of bulk requests, oldest first */
    int waiting_count;
} usb_device;

/* A request of endpoint 0, as it goes over the wire. */
typedef struct usb_setup {
    uint8_t type, request;
    uint16_t value, index, length;
} usb_setup;

/* Answers a setup: `out` holds what the host sent, `in` takes at most 4096 bytes for it. Bytes of the answer;
 * -1: there is no such request. */
typedef int (*usb_answer)(void *user, const usb_setup *setup, const uint8_t *out, uint8_t *in);

/* Plugs in a high-speed device, waiting at most 5 s for the port to be free. 0: it cannot be done. */
int usb_plug(usb_device *device);
void usb_unplug(usb_device *device);

/* Serves one request of the host, if one comes within `timeout_ms`. 0: the host let go of the device. */
int usb_serve(usb_device *device, int timeout_ms, usb_answer answer, void *user);

/* Answers the oldest bulk request. */
void usb_send(usb_device *device, const uint8_t *data, size_t bytes);

#endif
