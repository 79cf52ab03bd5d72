/* calibrate.h - boards of AprilTags: drawn, found in pictures; cameras calibrated and placed by them.
 *
 * A calibration: sf_board_open, sf_detector_create; for each frame sf_detector_find_in_frame and
 * sf_observations_offer, until sf_observations_advice has none; sf_calibrate; sf_calibration_save.
 * The equations are in src/pose/README.md.
 */
#ifndef SPLATFIT_CALIBRATE_H
#define SPLATFIT_CALIBRATE_H

#include "camera.h"
#include "context.h"
#include "source.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Boards. */

/* A tag: the four corners of its black square, in metres in the board's frame: top left, top right, bottom
 * right, bottom left of the tag as it is drawn upright. */
typedef struct sf_board_tag {
    int32_t id;          /* within its family */
    double corner[4][2]; /* m */
} sf_board_tag;

/* A flat board. Its frame: +x right and +y down for who reads it, +z into the board, which lies at z = 0. The
 * origin of a board that splatfit draws is the middle of its tags. */
typedef struct sf_board {
    char name[64];            /* as it was opened */
    char family[32];          /* libapriltag's name, "tag36h11" */
    double tag_size;          /* m: the side of the black squares */
    double width, height;     /* m: the sheet; 0: not known */
    size_t count;             /* tags, at least 1 */
    const sf_board_tag *tags; /* by id, ascending */
} sf_board;

/* A board by name, "a4-36h11", "letter-36h11" or "a3-36h11", or described by a JSON file (a name that ends in
 * ".json"; src/pose/README.md). tag_size_m: the side of a black square as it was measured, where it was
 * printed at another scale: the whole board is scaled with it; 0: as the board says. SF_ERR_ARGUMENT: no such
 * board, tag_size_m not in 0.001..10; SF_ERR_IO; SF_ERR_FORMAT: the file is no description, named by field.
 */
SF_API sf_status sf_board_open(sf_context *context, const char *name, double tag_size_m, sf_board **board);
SF_API void sf_board_close(sf_board **board);

/* Draws a board at its true size: the ending of `path` says .svg, .pdf or .png (300 dots an inch), or .json
 * for the description. Whole or not at all. SF_ERR_ARGUMENT: another ending, a board without a sheet (from a
 * file); SF_ERR_UNSUPPORTED: not built with libapriltag (.json needs none); SF_ERR_IO. */
SF_API sf_status sf_board_write(sf_context *context, const sf_board *board, const char *path);

/* Detection. */

/* A corner of a tag as a picture shows it. */
typedef struct sf_board_corner {
    int32_t id, corner; /* the tag's; 0..3 as in sf_board_tag */
    double board[2];    /* m, in the board's frame */
    double pixel[2];    /* px; pixel (i, j) covers [i, i+1) x [j, j+1) */
} sf_board_corner;

/* Looks for the tags of one board. One thread at a time may use it. */
typedef struct sf_detector sf_detector;

/* Finds tags of a board. decimate: 1 (best) .. 8, pictures are reduced by it to look for tags, whose edges
 * are then found at full size. The board may be closed after it. SF_ERR_ARGUMENT: decimate out of range;
 * SF_ERR_UNSUPPORTED: not built with libapriltag, or a family that it lacks. */
SF_API sf_status sf_detector_create(sf_context *context, const sf_board *board, int decimate,
                                    sf_detector **detector);
SF_API void sf_detector_destroy(sf_detector **detector);

/* The corners of all tags of the board in a grey picture (width, height 1..65535 px, rows `stride` bytes
 * apart): four in a row for a tag, tags by id; none found is no error. A tag that is seen twice is left out.
 * *corners is the detector's own and stands until its next call. */
SF_API sf_status sf_detector_find(sf_detector *detector, const uint8_t *grey, size_t stride, int32_t width,
                                  int32_t height, const sf_board_corner **corners, size_t *count);

/* The same in a frame of any format, as sf_frame_convert fails. */
SF_API sf_status sf_detector_find_in_frame(sf_detector *detector, const sf_frame *frame,
                                           const sf_board_corner **corners, size_t *count);

/* Poses. */

/* Where a camera sees a board: p_c = R_cb p_b + t_cb, camera axes as in camera.h. */
typedef struct sf_pose {
    double R_cb[9]; /* row-major */
    double t_cb[3]; /* m */
    /* Covariance of the left twist (rho, phi), p_c' = p_c + rho + phi x p_c: m and radians, row-major 6 x 6.
     * Computed from the corners' residuals, at least 0.1 px, and from the uncertainty of the edge bias. */
    double covariance[36];
    double rms; /* px, of the distances of the corners that were used */
    /* A flat board that appears small has two poses that explain it, mirrored about the line of sight. This
     * is the rms of the pose over that of the other: 0 (no second pose) .. 1 (they fit equally well). Above
     * 0.7, do not trust the tilt. */
    double ambiguity;
    size_t used, rejected; /* corners */
} sf_pose;

/* The pose of a board in one picture, taken through a known lens, from at least 4 corners. Robust: corners
 * that do not fit are rejected. The edge bias, by which ink or blooming moves all edges of the tags outwards
 * or inwards, is estimated too (src/pose/README.md, P.6); that needs several tags, each with its four corners
 * in a row. SF_ERR_ARGUMENT: the lens is not valid; SF_ERR_EMPTY: fewer than 4 corners, or no pose explains
 * them (all in a line). */
SF_API sf_status sf_board_pose(sf_context *context, const sf_lens *lens, const sf_board_corner *corners,
                               size_t count, sf_pose *pose);

/* Calibration. */

/* The views of a calibration: the corners of a board in pictures of one camera. */
typedef struct sf_observations sf_observations;

/* For pictures of width x height px, 16..65535 each. */
SF_API sf_status sf_observations_create(sf_context *context, int32_t width, int32_t height,
                                        sf_observations **observations);
SF_API void sf_observations_destroy(sf_observations **observations);

/* Adds a view as it is. SF_ERR_ARGUMENT: fewer than 4 corners, one outside of the picture's surroundings
 * (a width or height beyond it) or not finite. */
SF_API sf_status sf_observations_add(sf_observations *observations, const sf_board_corner *corners,
                                     size_t count);

/* Adds a view if it is informative: at least 8 corners, and the board at another position, distance or tilt
 * than in every earlier view, or in a part of the picture without corners so far. *taken: 0 or 1. */
SF_API sf_status sf_observations_offer(sf_observations *observations, const sf_board_corner *corners,
                                       size_t count, int *taken);

/* Views so far. */
SF_API size_t sf_observations_count(const sf_observations *observations);

/* The share of the 8 x 6 cells of the picture in which a corner was seen, 0..1. */
SF_API double sf_observations_coverage(const sf_observations *observations);

/* An instruction to the person who holds the board, about the views that are still missing ("tilt its left
 * edge towards the camera"); NULL: no view is missing. */
SF_API const char *sf_observations_advice(const sf_observations *observations);

/* The parameters that are estimated. */
typedef struct sf_calibrate_options {
    int fix_aspect; /* fx = fy */
    int fix_center; /* cx, cy: the middle of the picture */
    int radial;     /* 0: k1 = k2 = 0; 1: k1; 2: both */
    int tangential; /* 0: p1 = p2 = 0 */
} sf_calibrate_options;

/* {0, 0, 2, 1}. */
SF_API sf_calibrate_options sf_calibrate_options_default(void);

/* A calibrated camera. Fields that a file does not contain are 0. */
typedef struct sf_calibration {
    int32_t width, height;    /* px */
    sf_lens lens;             /* as estimated */
    sf_lens sigma;            /* standard deviations; 0: fixed, or not known */
    double rms;               /* px: root of the mean squared distance of the corners that were used */
    double worst_rms;         /* px: the greatest rms of a view */
    double coverage;          /* share of the 8 x 6 cells of the picture with a corner that was used */
    double tilt_most;         /* degrees between the camera's axis and the board's, the greatest */
    double tilt_spread;       /* degrees between the board's axes in two views, the greatest */
    size_t views, worst_view; /* used; index among the observations */
    size_t views_rejected;    /* did not fit */
    size_t corners, corners_rejected; /* of the views that were used */
} sf_calibration;

/* Least squares over the lens and the poses of all views, robust; corners that do not fit are rejected, and
 * views of which fewer than 6 corners, or fewer than half, fit. SF_ERR_EMPTY, with advice in the message:
 * fewer than 3 views fit, all boards face the camera, all have the same tilt, or the focal length is
 * uncertain by more than 3 %. Tilts that differ by less than 15 degrees and a focal length uncertain by more
 * than 0.5 % are logged as warnings. SF_ERR_ARGUMENT: radial not in 0..2. */
SF_API sf_status sf_calibrate(sf_observations *observations, const sf_calibrate_options *options,
                              sf_calibration *calibration);

/* A view after sf_calibrate. */
typedef struct sf_observation_info {
    int rejected;                     /* the whole view */
    size_t corners, corners_rejected; /* of `corners` */
    double rms;                       /* px, of those used; 0 where rejected */
    double R_cb[9], t_cb[3];          /* as in sf_pose */
} sf_observation_info;

/* SF_ERR_END past the last. */
SF_API sf_status sf_observations_get(const sf_observations *observations, size_t index,
                                     sf_observation_info *info);

/* Writes a calibration as JSON, whole or not at all. */
SF_API sf_status sf_calibration_save(sf_context *context, const sf_calibration *calibration,
                                     const char *path);

/* Reads a calibration; the content tells the format: JSON as sf_calibration_save writes it; OpenCV's YAML,
 * XML and JSON (camera_matrix, cameraMatrix or K; distortion_coefficients, dist_coeffs, distCoeffs or D, of
 * 4, or 5 to 14 with 0 from k4 on; image_width and image_height, or image_size or imageSize, [width, height];
 * OpenCV counts from the first pixel's middle: 0.5 is added to cx and cy); COLMAP's cameras.txt and
 * cameras.bin, of models that are an sf_lens and where all cameras are one. SF_ERR_IO; SF_ERR_FORMAT:
 * damaged, a field is missing, not finite or out of range; SF_ERR_UNSUPPORTED: another lens model
 * (fisheye_model: 1), k4..k6, several cameras. */
SF_API sf_status sf_calibration_load(sf_context *context, const char *path, sf_calibration *calibration);

#ifdef __cplusplus
}
#endif
#endif
