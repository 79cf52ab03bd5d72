/* opencv_file.h - calibrations that programs wrote with OpenCV's cv::FileStorage: YAML, XML, JSON. */
#ifndef SF_POSE_OPENCV_FILE_H
#define SF_POSE_OPENCV_FILE_H

#include <jansson.h>

#include <splatfit/calibrate.h>

/* Whether it is one of OpenCV's, told by its first bytes and its keys. */
int sf_opencv_is_text(const char *text);   /* YAML or XML */
int sf_opencv_is_json(const json_t *root); /* an object; not one that sf_calibration_save writes */

/* Reads size and lens of `text`, or of `root` where that is not NULL. SF_ERR_FORMAT: damaged, a key is
 * missing or not a number; SF_ERR_UNSUPPORTED: skew, a fisheye, coefficients that an sf_lens does not have.
 */
sf_status sf_opencv_read(sf_context *ctx, const char *path, const char *text, const json_t *root,
                         sf_calibration *calibration);

#endif
