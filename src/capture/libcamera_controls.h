/* libcamera_controls.h - which of libcamera's controls to set for what is asked for.
 *
 * Until 0.4 there is one switch, AeEnable, for exposure time and gain together. From 0.5 on there is one for
 * each, ExposureTimeMode and AnalogueGainMode: a time or a gain that is given while its mode is automatic is
 * ignored, and AeEnable stands for both (libcamera's control_ids_core.yaml). A webcam may have some of them.
 */
#ifndef SF_CAPTURE_LIBCAMERA_CONTROLS_H
#define SF_CAPTURE_LIBCAMERA_CONTROLS_H

#include "libcamera_device.h"
#include "libcamera_name.h"

/* What to set a switch to. */
typedef enum sf_auto { SF_AUTO_LEAVE = -1, SF_AUTO_OFF, SF_AUTO_ON } sf_auto;

/* The switches that the camera has, each 0 or 1: a mode counts where it can be both automatic and manual. */
typedef struct sf_libcamera_has {
    int enable, exposure_mode, gain_mode, white_balance;
} sf_libcamera_has;

/* What to set. */
typedef struct sf_libcamera_controls {
    sf_auto enable, exposure_mode, gain_mode, white_balance;
    int exposure_us;  /* 0: leave */
    double gain;      /* 0: leave */
    int64_t frame_us; /* from a frame to the next; 0: leave */
} sf_libcamera_controls;

/* SF_ERR_UNSUPPORTED: automatic exposure is asked for, and there is none. */
sf_status sf_libcamera_check_auto(const sf_libcamera_device *device, sf_libcamera_has has,
                                  const sf_libcamera_request *asked);

/* Nothing. */
sf_libcamera_controls sf_libcamera_controls_none(void);
/* Before the first frame. */
sf_libcamera_controls sf_libcamera_controls_open(sf_libcamera_has has, const sf_libcamera_request *asked);
/* To lock what is automatic, or to let it go on: what was given by hand stays so. */
sf_libcamera_controls sf_libcamera_controls_lock(sf_libcamera_has has, const sf_libcamera_request *asked,
                                                 int locked);

/* Whether anything of it can be locked. */
int sf_libcamera_can_lock(sf_libcamera_has has);

#endif
