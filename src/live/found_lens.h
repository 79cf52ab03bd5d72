/* found_lens.h - a lens that is found on the way: pictures as they come are taken for a pinhole camera's;
 * from then on they are corrected. */
#ifndef SF_LIVE_FOUND_LENS_H
#define SF_LIVE_FOUND_LENS_H

#include <splatfit/remap.h>

#include "frame_grabber.h"

typedef struct sf_found_lens {
    sf_context *ctx;
    int is_found;
    size_t checked_at; /* keyframes, when the focal length was last adjusted */
    sf_lens lens;      /* px of the pictures */
    sf_remap *remap;   /* NULL: pictures stay as they are, but for their camera */
    sf_camera camera;
    sf_picture picture; /* the one corrected last */
    float *planes;      /* of it, and its weight, where pictures are remapped */
    size_t capacity;    /* floats */
} sf_found_lens;

/* Pictures of width x height px go through `lens` from now on. On failure all is as it was. SF_ERR_MEMORY;
 * SF_ERR_ARGUMENT: no lens. */
sf_status sf_found_lens_set(sf_found_lens *found, const sf_lens *lens, int32_t width, int32_t height);

/* *corrected: the picture, or as the lens would have shown it without distortion: good until the next call.
 * SF_ERR_MEMORY. */
sf_status sf_found_lens_correct(sf_found_lens *found, const sf_picture *picture,
                                const sf_picture **corrected);

/* The focal length is `zoom` times as long; pictures are remapped as before. */
void sf_found_lens_zoom(sf_found_lens *found, double zoom);

/* Back to a lens that is not found. */
void sf_found_lens_forget(sf_found_lens *found);
void sf_found_lens_free(sf_found_lens *found);

#endif
