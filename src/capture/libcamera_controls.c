/* libcamera_controls.c - see libcamera_controls.h. */
#include "libcamera_controls.h"

#include <math.h>

sf_status sf_libcamera_check_auto(const sf_libcamera_device *device, sf_libcamera_has has,
                                  const sf_libcamera_request *asked) {
    if (asked->exposure_us >= 0 || has.enable || has.exposure_mode) return SF_OK;
    return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "exposure: has no automatic exposure");
}

sf_libcamera_controls sf_libcamera_controls_none(void) {
    return (sf_libcamera_controls){.enable = SF_AUTO_LEAVE,
                                   .exposure_mode = SF_AUTO_LEAVE,
                                   .gain_mode = SF_AUTO_LEAVE,
                                   .white_balance = SF_AUTO_LEAVE};
}

sf_libcamera_controls sf_libcamera_controls_open(sf_libcamera_has has, const sf_libcamera_request *asked) {
    sf_libcamera_controls set = sf_libcamera_controls_none();
    sf_auto exposure = asked->exposure_us < 0 ? SF_AUTO_ON : SF_AUTO_OFF;
    if (asked->exposure_us && has.exposure_mode)
        set.exposure_mode = exposure;
    else if (asked->exposure_us && has.enable)
        set.enable = exposure;
    if (asked->gain > 0 && has.gain_mode) set.gain_mode = SF_AUTO_OFF;
    if (asked->exposure_us > 0) set.exposure_us = asked->exposure_us;
    if (asked->gain > 0) set.gain = asked->gain;
    if (asked->fps > 0) set.frame_us = llround(1e6 / asked->fps);
    return set;
}

sf_libcamera_controls sf_libcamera_controls_lock(sf_libcamera_has has, const sf_libcamera_request *asked,
                                                 int locked) {
    sf_libcamera_controls set = sf_libcamera_controls_none();
    sf_auto to = locked ? SF_AUTO_OFF : SF_AUTO_ON;
    int by_hand = asked->exposure_us > 0;
    if (has.exposure_mode && !by_hand) set.exposure_mode = to;
    if (has.gain_mode && asked->gain <= 0) set.gain_mode = to;
    if (has.enable && !has.exposure_mode && !has.gain_mode && !by_hand) set.enable = to;
    if (has.white_balance) set.white_balance = to;
    return set;
}

int sf_libcamera_can_lock(sf_libcamera_has has) {
    return has.enable || has.exposure_mode || has.gain_mode || has.white_balance;
}
