/* throttling.h - whether the kernel throttles the processor because it is hot. */
#ifndef SF_LIVE_THROTTLING_H
#define SF_LIVE_THROTTLING_H

#include <stddef.h>

/* Looks into the kernel's folder, usually /sys, and says what it finds in `what`, for example "thermal_zone0:
 * 85.1 degrees, 85.0 at most". 1: held back by
 *   - a cooling device of the processor (class/thermal/cooling_device*: a state above 0),
 *   - a zone as warm as a passive trip point of it (class/thermal/thermal_zone*), or
 *   - the firmware of a Raspberry Pi (devices/platform/soc/soc:firmware/get_throttled: bits 1 to 3);
 * 0: by none, or nothing of this is told. */
int sf_is_throttled(const char *folder, char *what, size_t size);

#endif
