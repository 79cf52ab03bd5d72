/* found_lens.c - see found_lens.h. */
#include "found_lens.h"

#include <math.h>

#include "../io/optics.h"

sf_status sf_found_lens_set(sf_found_lens *f, const sf_lens *lens, int32_t width, int32_t height) {
    sf_remap *remap;
    sf_status status = sf_remap_create(f->ctx, lens, width, height, 1, &remap);
    if (status) return status;
    sf_found_lens_forget(f);
    sf_remap_camera(remap, &f->camera);
    if (sf_lens_is_distorted(lens))
        f->remap = remap;
    else
        sf_remap_destroy(&remap);
    f->lens = *lens;
    f->is_found = 1;
    return SF_OK;
}

sf_status sf_found_lens_correct(sf_found_lens *f, const sf_picture *picture, const sf_picture **corrected) {
    size_t width = (size_t)picture->camera.width, pixels = width * (size_t)picture->camera.height;
    *corrected = picture;
    if (!f->is_found) return SF_OK;
    if (f->remap) {
        sf_status status = sf_grow(f->ctx, &f->planes, &f->capacity, 0, 4 * pixels, sizeof *f->planes);
        if (status) return status;
    }
    f->picture = *picture;
    f->picture.camera = f->camera;
    f->picture.is_lens_guessed = 0;
    *corrected = &f->picture;
    if (!f->remap) return SF_OK;
    for (size_t c = 0; c < 3; c++) f->picture.rgb[c] = f->planes + c * pixels;
    f->picture.weight = f->planes + 3 * pixels;
    return sf_remap_run(f->remap, picture->rgb, width, f->picture.rgb, width, f->picture.weight);
}

void sf_found_lens_zoom(sf_found_lens *f, double zoom) {
    sf_lens *l = &f->lens;
    l->fx *= zoom, l->fy *= zoom;
    l->k1 *= zoom * zoom, l->k2 *= pow(zoom, 4); /* of rays; those of pixels stay */
    f->camera.fx *= zoom, f->camera.fy *= zoom;
}

void sf_found_lens_forget(sf_found_lens *f) {
    sf_remap_destroy(&f->remap);
    f->is_found = 0;
}

void sf_found_lens_free(sf_found_lens *f) {
    sf_found_lens_forget(f);
    sf_free(f->ctx, f->planes);
    f->planes = NULL, f->capacity = 0;
}
