/* compare.h - two models rendered from the same places: how much one differs from the other. */
#ifndef APP_COMPARE_H
#define APP_COMPARE_H

#include "app.h"

/* Means over the views of one kind. */
typedef struct compared_views {
    const char *name; /* "held out", "train", "ring" */
    size_t views;
    double psnr, ssim;              /* of the second model's renders against the first's */
    double psnr_first, psnr_second; /* of each model against the project's pictures; 0: no pictures */
} compared_views;

typedef struct comparison {
    compared_views kinds[2];
    int number;   /* of kinds */
    json_t *list; /* {name, psnr, ssim} of each view */
} comparison;

/* --background and --near-plane. */
extern const arg_option compare_options[];

/* Compares over the views of a scene, held-out ones and those to train on apart; where scene is NULL over
 * COMPARE_RING standard views. 0 or an exit code; compare_free the result in both cases. */
enum { COMPARE_RING = 8 };
int compare_models(const args *a, sf_context *ctx, const sf_model *first, const sf_model *second,
                   sf_scene *scene, comparison *result);
void compare_free(comparison *result);

void compare_print(const comparison *result);
json_t *compare_json(const comparison *result);

#endif
