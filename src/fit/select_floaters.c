/* select_floaters.c - what stands before a lens.
 *
 * Pictures differ in how bright they came out, and a faint Gaussian around the place that one was taken from,
 * or close before it, makes that picture brighter, and hardly any other. From beside it, where nobody looked,
 * it hides the scene. So no Gaussian that is charged for may have a camera inside, or be much nearer to one
 * than where what that camera sees begins: neither things nor the air between is such.
 */
#include "select_floaters.h"

#include <math.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "../scene/scene.h"
#include "refine.h"

/* Standard deviations from the middle of a Gaussian in which no camera may be. */
#define VEIL_REACH 2.0

/* Of so many Gaussians at most, the depth that this share of those in the picture is nearer than, and the
 * part of it before which nothing stands. Fewer in the picture than the least do not tell. */
#define VEIL_SAMPLES 8192
#define VEIL_LEAST   100
#define VEIL_SHARE   0.01
#define VEIL_PART    0.6

/* Half the width and height of what counts as in the picture, in halves of the picture's. */
#define VEIL_WIDE 1.2

/* A place that a training view was taken from, as far as is known by now. */
typedef struct stand {
    sf_camera camera;
    double center[3];
    double nearest; /* depth before which nothing stands, world units; 0: not known */
} stand;

static void mean_of(const sf_params *p, size_t i, double mean[3]) {
    for (int k = 0; k < 3; k++) mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
}

/* The depth of a place in the picture, 0 outside it. */
static double depth_in(const sf_camera *c, const double place[3]) {
    double at[3];
    for (int k = 0; k < 3; k++) at[k] = sf_dot3(c->R_cw + 3 * k, place) + c->t_cw[k];
    int inside = at[2] > 0 && fabs(at[0]) * c->fx < VEIL_WIDE / 2 * c->width * at[2] &&
                 fabs(at[1]) * c->fy < VEIL_WIDE / 2 * c->height * at[2];
    return inside ? at[2] : 0;
}

/* depths: [VEIL_SAMPLES] to work in. */
static double nearest_of(const sf_model *model, const sf_camera *camera, double *depths) {
    size_t stride = (model->count + VEIL_SAMPLES - 1) / VEIL_SAMPLES, n = 0;
    for (size_t i = 0; i < model->count; i += stride) {
        double mean[3];
        mean_of(&model->params, i, mean);
        depths[n] = depth_in(camera, mean);
        n += depths[n] > 0;
    }
    return n < VEIL_LEAST ? 0 : VEIL_PART * sf_ranked(depths, n, (size_t)(VEIL_SHARE * (double)n));
}

/* Where the training views were taken from: *stands [*count], sf_free'd by the caller. */
static sf_status find_stands(const sf_fitter *f, double *depths, stand **stands, size_t *count) {
    sf_view **views;
    sf_status status = sf_scene_retain_training(f->scene, &views, count);
    *stands = status ? NULL : sf_alloc(f->ctx, *count, sizeof **stands);
    for (size_t k = 0; *stands && k < *count; k++) {
        stand *s = *stands + k;
        s->camera = views[k]->camera;
        sf_refine_camera(&f->views, views[k]->id, &s->camera);
        sf_camera_center(&s->camera, s->center);
        s->nearest = nearest_of(f->model, &s->camera, depths);
    }
    sf_scene_release_all(f->scene, views, *count);
    return *stands ? SF_OK : SF_ERR_MEMORY;
}

/* Whether a place is inside Gaussian i, whose longest axis is `longest` long. */
static int encloses(const sf_params *p, size_t i, const double mean[3], double longest,
                    const double place[3]) {
    double away[3], square = 0;
    for (int k = 0; k < 3; k++) {
        away[k] = place[k] - mean[k];
        square += away[k] * away[k];
    }
    if (!(square < VEIL_REACH * VEIL_REACH * longest * longest)) return 0;
    square = 0;
    for (int axis = 0; axis < 3; axis++) {
        float direction[3];
        sf_axis_of(p, i, axis, direction);
        double along = 0;
        for (int k = 0; k < 3; k++) along += away[k] * (double)direction[k];
        along /= exp((double)*sf_value(p, SF_FIELD_log_scale, i, axis));
        square += along * along;
    }
    return square < VEIL_REACH * VEIL_REACH;
}

static int is_veil(const sf_fitter *f, size_t i, const stand *stands, size_t count) {
    const sf_params *p = &f->model->params;
    double mean[3], longest = 0;
    mean_of(p, i, mean);
    for (int k = 0; k < 3; k++) longest = fmax(longest, exp((double)*sf_value(p, SF_FIELD_log_scale, i, k)));
    /* or would have to be nearer than is drawn */
    int large = VEIL_REACH * longest > (double)f->near_plane;
    for (const stand *s = stands; s < stands + count; s++) {
        if (large && encloses(p, i, mean, longest, s->center)) return 1;
        double depth = s->nearest > 0 ? depth_in(&s->camera, mean) : 0;
        if (depth > 0 && depth < s->nearest) return 1;
    }
    return 0;
}

sf_status sf_mark_floaters(sf_fitter *f) {
    double *depths = sf_alloc(f->ctx, VEIL_SAMPLES, sizeof *depths);
    stand *stands = NULL;
    size_t count = 0;
    sf_status status = depths ? find_stands(f, depths, &stands, &count) : SF_ERR_MEMORY;
    for (size_t i = 0; i < f->model->count && !status; i++)
        if (is_veil(f, i, stands, count)) f->densify.gradient_sum[i] = -1;
    sf_free(f->ctx, stands);
    sf_free(f->ctx, depths);
    return status;
}
