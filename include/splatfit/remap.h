/* remap.h - pictures of a lens as a pinhole camera would have taken them, and smaller.
 *
 * What is the same for every frame of a camera is worked out once: where each pixel comes from.
 */
#ifndef SPLATFIT_REMAP_H
#define SPLATFIT_REMAP_H

#include <stddef.h>
#include <stdint.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A lens, a size and a factor, worked out. Several threads may use one. */
typedef struct sf_remap sf_remap;

/* For pictures of width x height px (1..65535) through the lens, to be made smaller by the whole factor
 * `downscale` (1..64, no more than a side). Keeps 8 bytes for every pixel of the picture, none where the lens
 * does not distort. SF_ERR_ARGUMENT: a value out of range, a lens that is not finite or whose focal length is
 * not above 0 (named); SF_ERR_MEMORY. On failure *remap is NULL. */
SF_API sf_status sf_remap_create(sf_context *context, const sf_lens *lens, int32_t width, int32_t height,
                                 int downscale, sf_remap **remap);
/* Sets *remap to NULL. NULL is allowed. */
SF_API void sf_remap_destroy(sf_remap **remap);

/* The pinhole camera of the result: the lens' focal lengths and principal point and the size, divided by
 * `downscale` as by sf_camera_downscaled; it stands at the origin and looks along +z. */
SF_API void sf_remap_camera(const sf_remap *remap, sf_camera *camera);

/* Remaps a picture, three planes of height x stride floats, stride >= width, to out[c] of the camera's height
 * x out_stride. weight, of the same size as a plane of the result, or NULL: the share of each pixel, 0..1,
 * that the picture shows; of what it does not show, the colour is 0. The planes must not overlap. The result
 * does not depend on the number of threads. SF_ERR_ARGUMENT: a stride is less than its width. */
SF_API sf_status sf_remap_run(const sf_remap *remap, float *const rgb[3], size_t stride, float *const out[3],
                              size_t out_stride, float *weight);

#ifdef __cplusplus
}
#endif
#endif
