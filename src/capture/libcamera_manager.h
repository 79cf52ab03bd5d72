/* libcamera_manager.h - which context of the process has libcamera's manager, and for how long.
 *
 * libcamera allows a process one CameraManager at a time and ends the process at the second. The context owns
 * the manager, for as long as any of its sources or lists needs it. That no other context of the process has
 * one is kept by the kernel: whoever makes a manager holds a lock on the process's own entry in /proc, of
 * which there is one a process, however often this library is in it, and which goes with the process.
 */
#ifndef SF_CAPTURE_LIBCAMERA_MANAGER_H
#define SF_CAPTURE_LIBCAMERA_MANAGER_H

#include "../base/context.h"

/* What makes a manager and ends it: libcamera.cc, or a test. */
typedef struct sf_libcamera_maker {
    const char *(*start)(void **manager); /* why there is none, or NULL */
    void (*stop)(void *manager);
} sf_libcamera_maker;

/* A share of the context's manager, which the first one starts. Why there is none, or NULL. */
const char *sf_libcamera_share(sf_context *ctx, const sf_libcamera_maker *maker, void **manager);

/* Gives a share back; the last one ends the manager. */
void sf_libcamera_unshare(sf_context *ctx);

#endif
