/* evaluation.c - see evaluation.h. */
#include "evaluation.h"

#include <math.h>

#include "../base/clock.h"
#include "live.h"

#define EVERY 0.5 /* s */

static sf_status quality_of(sf_live *live, size_t at, sf_quality *quality) {
    sf_camera camera;
    double gain[3], bias[3];
    uint32_t id = live->keyframes.list[at].id;
    sf_status status = sf_fitter_get_camera(live->fitter, id, &camera);
    size_t pixels = (size_t)camera.width * (size_t)camera.height;
    if (status) return status;
    float *rgb = sf_alloc(live->ctx, 7 * pixels, sizeof *rgb);
    if (!rgb) return SF_ERR_MEMORY;
    sf_image_out out = {.rgb = rgb};
    status = sf_scene_get_pixels(live->scene, id, rgb + 3 * pixels, rgb + 6 * pixels);
    if (!status) status = sf_fitter_render(live->fitter, &camera, &out);
    if (!status)
        status = sf_compare(live->evaluation.renderer, camera.width, camera.height, rgb, rgb + 3 * pixels,
                            rgb + 6 * pixels, quality);
    int exposes = live->keyframes.list[at].held_out && live->options.fit.exposure;
    if (!status && exposes && sf_neighbours_exposure(&live->keyframes, live->fitter, at, gain, bias)) {
        double corrected = quality->psnr_corrected; /* as drawn: an exposure has no more to say of it */
        for (size_t i = 0; i < 3 * pixels; i++) rgb[i] = (float)(gain[i % 3] * (double)rgb[i] + bias[i % 3]);
        status = sf_compare(live->evaluation.renderer, camera.width, camera.height, rgb, rgb + 3 * pixels,
                            rgb + 6 * pixels, quality);
        quality->psnr_corrected = corrected;
    }
    sf_free(live->ctx, rgb);
    return status == SF_ERR_EMPTY ? SF_OK : status;
}

/* Only the first keyframe and those held out are evaluated. */
static sf_status evaluate_keyframe(sf_live *live, size_t at) {
    sf_keyframe *k = &live->keyframes.list[at];
    sf_quality quality = {NAN, NAN, NAN};
    if (at && !k->held_out) return SF_OK;
    sf_status status = quality_of(live, at, &quality);
    k->psnr = quality.psnr, k->psnr_corrected = quality.psnr_corrected;
    return status;
}

sf_status sf_live_evaluate(sf_live *live) {
    double now = sf_clock();
    if (!live->fitter || !live->keyframes.count || now < live->evaluation.last + EVERY) return SF_OK;
    live->evaluation.last = now;
    for (size_t i = 0; i < live->keyframes.count; i++) {
        size_t at = live->evaluation.next++ % live->keyframes.count;
        if (!at || live->keyframes.list[at].held_out) return evaluate_keyframe(live, at);
    }
    return SF_OK;
}

sf_status sf_live_evaluate_all(sf_live *live) {
    sf_status status = SF_OK;
    for (size_t i = 0; i < live->keyframes.count && live->fitter && !status; i++)
        status = evaluate_keyframe(live, i);
    return status;
}
