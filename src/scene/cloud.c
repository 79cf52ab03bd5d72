/* cloud.c - points and their colours. */
#include "cloud.h"

sf_status sf_cloud_create(sf_context *ctx, size_t n, sf_cloud *cloud) {
    cloud->n = 0;
    cloud->xyz = sf_alloc(ctx, n, 3 * sizeof *cloud->xyz);
    cloud->rgb = sf_alloc(ctx, n, 3);
    cloud->view = sf_calloc(ctx, n, sizeof *cloud->view);
    if (cloud->xyz && cloud->rgb && cloud->view) return SF_OK;
    sf_cloud_destroy(ctx, cloud);
    return SF_ERR_MEMORY;
}

void sf_cloud_destroy(sf_context *ctx, sf_cloud *cloud) {
    sf_free(ctx, cloud->xyz);
    sf_free(ctx, cloud->rgb);
    sf_free(ctx, cloud->view);
    *cloud = (sf_cloud){0};
}
