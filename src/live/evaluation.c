/* evaluation.c - see evaluation.h. */
#include "evaluation.h"

#include <math.h>

#include "../base/clock.h"
#include "../base/context.h"
#include "keyframe_exposure.h"

#define EVERY 0.5 /* s */

/* A keyframe beside the model drawn as it does. */
typedef struct pair {
    sf_camera camera;
    float *drawn, *seen, *weight; /* [height][width][3] twice, [height][width]; one block at `drawn` */
} pair;

static sf_status compare(const sf_evaluation *e, const pair *p, sf_quality *quality) {
    return sf_compare(e->renderer, p->camera.width, p->camera.height, p->drawn, p->seen, p->weight, quality);
}

/* p->drawn is the caller's to sf_free, also after a failure. */
static sf_status make_pair(const sf_evaluation *e, uint32_t id, sf_scene *scene, sf_fitter *fitter, pair *p) {
    sf_status status = sf_fitter_get_camera(fitter, id, &p->camera);
    if (status) return status;
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    p->drawn = sf_alloc(e->ctx, 7 * pixels, sizeof *p->drawn);
    if (!p->drawn) return SF_ERR_MEMORY;
    p->seen = p->drawn + 3 * pixels, p->weight = p->drawn + 6 * pixels;
    sf_image_out out = {.rgb = p->drawn};
    status = sf_scene_get_pixels(scene, id, p->seen, p->weight);
    return status ? status : sf_fitter_render(fitter, &p->camera, &out);
}

static void expose(pair *p, const double gain[3], const double bias[3]) {
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    for (size_t i = 0; i < 3 * pixels; i++)
        p->drawn[i] = (float)(gain[i % 3] * (double)p->drawn[i] + bias[i % 3]);
}

/* Only the first keyframe and those held out are evaluated. */
static sf_status evaluate_keyframe(const sf_evaluation *e, sf_keyframes *keyframes, size_t at,
                                   sf_scene *scene, sf_fitter *fitter) {
    sf_keyframe *k = &keyframes->list[at];
    sf_quality quality = {NAN, NAN, NAN};
    double gain[3], bias[3];
    pair p = {.drawn = NULL};
    if (at && !k->held_out) return SF_OK;
    sf_status status = make_pair(e, k->id, scene, fitter, &p);
    if (!status) status = compare(e, &p, &quality);
    if (!status && k->held_out && e->exposes && sf_neighbours_exposure(keyframes, fitter, at, gain, bias)) {
        double corrected = quality.psnr_corrected; /* as drawn: an exposure has no more to say of it */
        expose(&p, gain, bias);
        status = compare(e, &p, &quality);
        quality.psnr_corrected = corrected;
    }
    sf_free(e->ctx, p.drawn);
    k->psnr = quality.psnr, k->psnr_corrected = quality.psnr_corrected;
    return status == SF_ERR_EMPTY ? SF_OK : status;
}

sf_status sf_evaluate_next(sf_evaluation *e, sf_keyframes *keyframes, sf_scene *scene, sf_fitter *fitter) {
    double now = sf_clock();
    if (!keyframes->count || now < e->last + EVERY) return SF_OK;
    e->last = now;
    for (size_t i = 0; i < keyframes->count; i++) {
        size_t at = e->next++ % keyframes->count;
        if (!at || keyframes->list[at].held_out) return evaluate_keyframe(e, keyframes, at, scene, fitter);
    }
    return SF_OK;
}

sf_status sf_evaluate_all(const sf_evaluation *e, sf_keyframes *keyframes, sf_scene *scene,
                          sf_fitter *fitter) {
    sf_status status = SF_OK;
    for (size_t i = 0; i < keyframes->count && !status; i++)
        status = evaluate_keyframe(e, keyframes, i, scene, fitter);
    return status;
}
