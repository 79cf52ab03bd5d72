/* auto_exposure.h - which of libcamera's switches of automatic exposure to set.
 *
 * Until 0.4 there is one, AeEnable, for exposure time and gain together. From 0.5 on there is one for each,
 * ExposureTimeMode and AnalogueGainMode: a time or a gain that is given while its mode is automatic is
 * ignored, and AeEnable stands for both (libcamera's control_ids_core.yaml). A webcam may have some of them.
 */
#ifndef SF_CAPTURE_AUTO_EXPOSURE_H
#define SF_CAPTURE_AUTO_EXPOSURE_H

/* What to set a switch to. */
typedef enum sf_auto { SF_AUTO_LEAVE = -1, SF_AUTO_OFF, SF_AUTO_ON } sf_auto;

/* What the camera has, each 0 or 1: a mode counts where it can be both automatic and manual. */
typedef struct sf_auto_has {
    int enable, exposure_mode, gain_mode;
} sf_auto_has;

/* What the user asked for. */
typedef struct sf_auto_asked {
    int exposure_us; /* 0: the camera's choice, -1: automatic */
    double gain;     /* 0: the camera's choice */
} sf_auto_asked;

typedef struct sf_auto_set {
    sf_auto enable, exposure_mode, gain_mode;
} sf_auto_set;

/* Before the first frame. */
sf_auto_set sf_auto_open(sf_auto_has has, sf_auto_asked asked);
/* To lock what is automatic, or to let it go on: what was given by hand stays so. */
sf_auto_set sf_auto_lock(sf_auto_has has, sf_auto_asked asked, int locked);

#endif
