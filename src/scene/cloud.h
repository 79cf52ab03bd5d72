/* cloud.h - points and their colours. */
#ifndef SF_SCENE_CLOUD_H
#define SF_SCENE_CLOUD_H

#include "../base/context.h"

typedef struct sf_cloud {
    float *xyz;   /* [n][3], world units */
    uint8_t *rgb; /* [n][3] */
    uint32_t *
        view; /* [n]: the view that the colour is from, an index among the views given to the sweep; else 0 */
    size_t n;
} sf_cloud;

/* Makes room for n points; n itself stays 0. On failure nothing is allocated. */
sf_status sf_cloud_create(sf_context *ctx, size_t n, sf_cloud *cloud);
void sf_cloud_destroy(sf_context *ctx, sf_cloud *cloud);

#endif
