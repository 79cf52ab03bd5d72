/* baked.h - the simulated scene drawn fast: light and paint are worked out once and kept as textures.
 *
 * What is seen where is as exact as the ray caster's; textures are sampled a few times a pixel, and only
 * pixels at the edges of surfaces have several rays.
 */
#ifndef SF_SIM_BAKED_H
#define SF_SIM_BAKED_H

#include "../base/context.h"
#include "studio.h"

typedef struct sf_baked sf_baked;

/* For pictures of a camera of `focal` px, of at most `pixels` px, from about these eyes: what is near one of
 * them has finer textures. The studio must outlive it and stay as it is. SF_ERR_MEMORY. */
sf_status sf_baked_create(sf_context *ctx, const sf_studio *studio, const sf_vec3 *eyes, size_t count,
                          double focal, size_t pixels, sf_baked **baked);
void sf_baked_destroy(sf_baked **baked);

/* As sf_studio_draw; rgb may not be NULL. */
void sf_baked_draw(sf_baked *baked, const sf_camera *camera, float *rgb, float *depth);

#endif
