/* auto_exposure.c - which of libcamera's switches of automatic exposure to set. */
#include "auto_exposure.h"

static const sf_auto_set leave = {SF_AUTO_LEAVE, SF_AUTO_LEAVE, SF_AUTO_LEAVE};

sf_auto_set sf_auto_open(sf_auto_has has, sf_auto_asked asked) {
    sf_auto_set set = leave;
    sf_auto exposure = asked.exposure_us < 0 ? SF_AUTO_ON : SF_AUTO_OFF;
    if (asked.exposure_us && has.exposure_mode)
        set.exposure_mode = exposure;
    else if (asked.exposure_us && has.enable)
        set.enable = exposure;
    if (asked.gain > 0 && has.gain_mode) set.gain_mode = SF_AUTO_OFF;
    return set;
}

sf_auto_set sf_auto_lock(sf_auto_has has, sf_auto_asked asked, int locked) {
    sf_auto_set set = leave;
    sf_auto to = locked ? SF_AUTO_OFF : SF_AUTO_ON;
    int by_hand = asked.exposure_us > 0;
    if (has.exposure_mode && !by_hand) set.exposure_mode = to;
    if (has.gain_mode && asked.gain <= 0) set.gain_mode = to;
    if (has.enable && !has.exposure_mode && !has.gain_mode && !by_hand) set.enable = to;
    return set;
}
