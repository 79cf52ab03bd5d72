/* guest_libcamera.c - the simulated webcam through libcamera. */
#include <stdio.h>
#include <string.h>

#include "guest.h"
#include "pattern.h"
#include "webcam.h"

const guest_test libcamera_tests[] = {{0}};
