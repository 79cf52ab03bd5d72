/* model_transform.h - a model turned, scaled, moved and cut, as the command line says. */
#ifndef APP_MODEL_TRANSFORM_H
#define APP_MODEL_TRANSFORM_H

#include "app.h"

/* --up, --rotate, --scale, --move and --crop. */
extern const arg_option model_transform_options[];

/* Reads them and does them, in that order; model NULL: reads them alone. *moved: whether the model is in
 * other axes than before. 0 or an exit code. */
int model_transform_apply(const args *a, sf_context *ctx, sf_model *model, int *moved);

/* --up, "x", "-x", ... "-z", as a unit vector. 0, or EXIT_USAGE after one line. */
int model_transform_up(const args *a, const char *text, double up[3]);

#endif
