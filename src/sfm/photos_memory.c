/* photos_memory.c - whether the cameras of photos can be found within the memory. */
#include "../base/memory.h"
#include "../base/pool.h"
#include "../io/mask.h"
#include "../io/paths.h"
#include "../io/picture.h"
#include "photos.h"

enum {
    PIXEL_BYTES = 6,    /* of a picture while it is decoded */
    FEATURE_BYTES = 300 /* descriptor, place, colour, track; its part of matches and points */
};

/* Pixels of a picture as it is decoded; 0: it cannot be read. Frees the path. */
static uint64_t pixels_of(sf_context *ctx, char *path, int side) {
    int width = 0, height = 0;
    uint64_t pixels = 0;
    if (path && !sf_picture_size_reduced(ctx, path, side, &width, &height))
        pixels = (uint64_t)width * (uint64_t)height;
    sf_free(ctx, path);
    return pixels;
}

/* Pixels of the largest photo, with its mask, which is decoded in full size. */
static uint64_t largest(sf_context *ctx, const char *folder, int side, const sf_photo_list *list) {
    uint64_t most = 0;
    for (size_t i = 0; i < list->count; i++) {
        const char *name = list->photos[i].name;
        char *mask = NULL;
        uint64_t pixels = pixels_of(ctx, sf_path_join(ctx, folder, name), side);
        if (list->masks && !sf_mask_look_for(ctx, list->masks, name, &mask))
            pixels += pixels_of(ctx, mask, 0);
        if (pixels > most) most = pixels;
    }
    return most;
}

sf_status sf_photos_check_memory(sf_context *ctx, const char *folder, int side,
                                 const sf_features_options *options, uint64_t memory,
                                 const sf_photo_list *list) {
    const uint64_t mega = 1048576;
    uint64_t budget = sf_memory_budget(memory), threads = (uint64_t)sf_pool_threads(ctx->pool);
    if (threads > list->count) threads = list->count;
    uint64_t a_thread =
        PIXEL_BYTES * largest(ctx, folder, side, list) + sf_features_memory(side, side, options);
    uint64_t features = (uint64_t)list->count * options->most * FEATURE_BYTES;
    uint64_t total = sf_memory_resident() + threads * a_thread + features;
    if (!budget || total <= budget) return SF_OK;
    return sf_fail(
        ctx, SF_ERR_MEMORY,
        "memory: %s: %zu photos take about %llu MB, %llu of them for %zu features each and %llu to "
        "read photos on %llu threads, but may take %llu MB: lower features or threads, or allow more memory",
        folder, list->count, (unsigned long long)(total / mega), (unsigned long long)(features / mega),
        options->most, (unsigned long long)(threads * a_thread / mega), (unsigned long long)threads,
        (unsigned long long)(budget / mega));
}
