/* evaluation.h - PSNR of the first keyframe and of those that are held out. */
#ifndef SF_LIVE_EVALUATION_H
#define SF_LIVE_EVALUATION_H

#include <splatfit/fitter.h>
#include <splatfit/render.h>
#include <splatfit/scene.h>

#include "keyframe_list.h"

typedef struct sf_evaluation {
    sf_context *ctx;
    sf_renderer *renderer; /* for sf_compare */
    int exposes;           /* the fit learns exposures: what is held out is compared with its neighbours' */
    size_t next;           /* index of the keyframe to evaluate next */
    double last;           /* time of the last evaluation, s */
} sf_evaluation;

/* Evaluates the next of the keyframes, twice a second: their pictures are the scene's. */
sf_status sf_evaluate_next(sf_evaluation *evaluation, sf_keyframes *keyframes, sf_scene *scene,
                           sf_fitter *fitter);
/* Evaluates all of them. */
sf_status sf_evaluate_all(const sf_evaluation *evaluation, sf_keyframes *keyframes, sf_scene *scene,
                          sf_fitter *fitter);

#endif
