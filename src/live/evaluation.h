/* evaluation.h - PSNR of the first keyframe and of those that are held out. */
#ifndef SF_LIVE_EVALUATION_H
#define SF_LIVE_EVALUATION_H

#include <splatfit/live.h>

typedef struct sf_evaluation {
    sf_renderer *renderer; /* for sf_compare */
    size_t next;           /* index of the keyframe to evaluate next */
    double last;           /* time of the last evaluation, s */
} sf_evaluation;

/* Evaluates the next one, twice a second. */
sf_status sf_live_evaluate(sf_live *live);
/* Evaluates all of them. */
sf_status sf_live_evaluate_all(sf_live *live);

#endif
