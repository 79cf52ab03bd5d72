/* select_floaters.c - near-camera floaters.
 *
 * Exposure differs between pictures. A faint Gaussian around one camera, or close in front of it, brightens
 * that picture and hardly any other; seen from other places it hides the scene. So no Gaussian may contain a
 * camera centre, or be much nearer to a camera than the nearest surfaces it sees.
 */
#include "select_floaters.h"

#include <math.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "../scene/scene.h"
#include "refine.h"

/* A Gaussian contains a camera centre within this many standard deviations of its mean. */
#define FLOATER_REACH 2.0

/* The nearest depth of a view is FLOATER_PART times the FLOATER_SHARE quantile of the depths of the Gaussians
 * in its picture, out of at most FLOATER_SAMPLES Gaussians of the model. It is unknown where fewer than
 * FLOATER_LEAST are in the picture. */
#define FLOATER_SAMPLES 8192
#define FLOATER_LEAST   100
#define FLOATER_SHARE   0.01
#define FLOATER_PART    0.6

/* A mean counts as in the picture up to this factor of half its width and height from the centre. */
#define PICTURE_MARGIN 1.2

/* The camera of a training view, with the corrections learned so far. */
typedef struct viewpoint {
    sf_camera camera;
    double center[3];
    double nearest; /* a Gaussian nearer than this is a floater, world units; 0: unknown */
} viewpoint;

static void mean_of(const sf_params *p, size_t i, double mean[3]) {
    for (int k = 0; k < 3; k++) mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
}

/* Depth of a point in the picture, 0 outside it. */
static double depth_in(const sf_camera *c, const double point[3]) {
    double at[3];
    for (int k = 0; k < 3; k++) at[k] = sf_dot3(c->R_cw + 3 * k, point) + c->t_cw[k];
    int inside = at[2] > 0 && fabs(at[0]) * c->fx < PICTURE_MARGIN / 2 * c->width * at[2] &&
                 fabs(at[1]) * c->fy < PICTURE_MARGIN / 2 * c->height * at[2];
    return inside ? at[2] : 0;
}

/* depths: [FLOATER_SAMPLES], scratch. */
static double nearest_of(const sf_model *model, const sf_camera *camera, double *depths) {
    size_t stride = (model->count + FLOATER_SAMPLES - 1) / FLOATER_SAMPLES, n = 0;
    for (size_t i = 0; i < model->count; i += stride) {
        double mean[3];
        mean_of(&model->params, i, mean);
        depths[n] = depth_in(camera, mean);
        n += depths[n] > 0;
    }
    return n < FLOATER_LEAST ? 0 : FLOATER_PART * sf_ranked(depths, n, (size_t)(FLOATER_SHARE * (double)n));
}

/* Cameras of the training views: *viewpoints [*count], sf_free'd by the caller. */
static sf_status find_viewpoints(const sf_fitter *f, double *depths, viewpoint **viewpoints, size_t *count) {
    sf_view **views;
    sf_status status = sf_scene_retain_training(f->scene, &views, count);
    *viewpoints = status ? NULL : sf_alloc(f->ctx, *count, sizeof **viewpoints);
    for (size_t k = 0; *viewpoints && k < *count; k++) {
        viewpoint *s = *viewpoints + k;
        s->camera = views[k]->camera;
        sf_refine_camera(&f->views, views[k]->id, &s->camera);
        for (int axis = 0; axis < 3; axis++)
            s->camera.t_cw[axis] = ldexp(s->camera.t_cw[axis], -f->model->unit);
        sf_camera_center(&s->camera, s->center);
        s->nearest = nearest_of(f->model, &s->camera, depths);
    }
    sf_scene_release_all(f->scene, views, *count);
    return *viewpoints ? SF_OK : SF_ERR_MEMORY;
}

/* Whether a point is inside Gaussian i; longest: the standard deviation of its longest axis. */
static int encloses(const sf_params *p, size_t i, const double mean[3], double longest,
                    const double point[3]) {
    double away[3], square = 0;
    for (int k = 0; k < 3; k++) {
        away[k] = point[k] - mean[k];
        square += away[k] * away[k];
    }
    if (!(square < FLOATER_REACH * FLOATER_REACH * longest * longest)) return 0;
    square = 0;
    for (int axis = 0; axis < 3; axis++) {
        float direction[3];
        sf_axis_of(p, i, axis, direction);
        double along = 0;
        for (int k = 0; k < 3; k++) along += away[k] * (double)direction[k];
        along /= exp((double)*sf_value(p, SF_FIELD_log_scale, i, axis));
        square += along * along;
    }
    return square < FLOATER_REACH * FLOATER_REACH;
}

static int is_floater(const sf_fitter *f, size_t i, const viewpoint *viewpoints, size_t count) {
    const sf_params *p = &f->model->params;
    double mean[3], longest = 0;
    mean_of(p, i, mean);
    for (int k = 0; k < 3; k++) longest = fmax(longest, exp((double)*sf_value(p, SF_FIELD_log_scale, i, k)));
    /* a smaller one that contains the centre is nearer than the near plane, and not drawn */
    int large = FLOATER_REACH * longest > ldexp((double)f->near_plane, -f->model->unit);
    for (const viewpoint *s = viewpoints; s < viewpoints + count; s++) {
        if (large && encloses(p, i, mean, longest, s->center)) return 1;
        double depth = s->nearest > 0 ? depth_in(&s->camera, mean) : 0;
        if (depth > 0 && depth < s->nearest) return 1;
    }
    return 0;
}

sf_status sf_mark_floaters(sf_fitter *f) {
    double *depths = sf_alloc(f->ctx, FLOATER_SAMPLES, sizeof *depths);
    viewpoint *viewpoints = NULL;
    size_t count = 0;
    sf_status status = depths ? find_viewpoints(f, depths, &viewpoints, &count) : SF_ERR_MEMORY;
    for (size_t i = 0; i < f->model->count && !status; i++)
        if (is_floater(f, i, viewpoints, count)) f->densify.gradient_sum[i] = -1;
    sf_free(f->ctx, viewpoints);
    sf_free(f->ctx, depths);
    return status;
}
