/* veil.c - what stands before a lens.
 *
 * Pictures differ in how bright they came out, and a faint Gaussian around the place that one was taken from,
 * or close before it, makes that picture brighter, and hardly any other. From beside it, where nobody looked,
 * it hides the scene. So no Gaussian that is charged for may have a camera inside, or be much nearer to one
 * than where what that camera sees begins: neither things nor the air between is such.
 */
#include "grow.h"

#include <math.h>

#include "../base/linear.h"
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

/* Standard deviations of a Gaussian that reach into a picture: there it stands as well as in the middle. */
#define VEIL_FLANK 1.0

/* A place that a training view was taken from. */
typedef struct stand {
    sf_camera camera;
    double center[3];
    double nearest; /* depth before which nothing stands, world units; 0: not known */
} stand;

static void mean_of(const sf_params *p, size_t i, double mean[3]) {
    for (int k = 0; k < 3; k++) mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
}

/* The depth of a place, and where it falls in the plane of depth 1; 0 if that is outside of the picture. */
static int look_at(const sf_camera *c, const double place[3], double at[3]) {
    for (int k = 0; k < 3; k++) at[k] = sf_dot3(c->R_cw + 3 * k, place) + c->t_cw[k];
    if (!(at[2] > 0)) return 0;
    at[0] /= at[2], at[1] /= at[2];
    double u = at[0] * c->fx + c->cx, v = at[1] * c->fy + c->cy;
    return u >= 0 && u <= c->width && v >= 0 && v <= c->height;
}

/* depths: [VEIL_SAMPLES] to work in. */
static double nearest_of(const sf_model *model, const sf_camera *camera, double *depths) {
    size_t stride = (model->count + VEIL_SAMPLES - 1) / VEIL_SAMPLES, n = 0;
    for (size_t i = 0; i < model->count; i += stride) {
        double mean[3], at[3];
        mean_of(&model->params, i, mean);
        if (look_at(camera, mean, at)) depths[n++] = at[2];
    }
    return n < VEIL_LEAST ? 0 : VEIL_PART * sf_select(depths, n, (size_t)(VEIL_SHARE * (double)n));
}

/* Where the training views were taken from: *stands [*count], sf_free'd by the caller. */
static sf_status find_stands(const sf_fitter *f, double *depths, stand **stands, size_t *count) {
    uint32_t *ids;
    size_t n, found = 0;
    *stands = NULL;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &n);
    if (status) return status;
    *stands = sf_alloc(f->ctx, n, sizeof **stands);
    for (size_t k = 0; *stands && k < n; k++) {
        sf_view *view = sf_scene_retain_id(f->scene, ids[k]);
        if (!view) continue;
        stand *s = *stands + found++;
        s->camera = view->camera;
        sf_camera_center(&view->camera, s->center);
        s->nearest = nearest_of(f->model, &view->camera, depths);
        sf_view_release(view);
    }
    sf_free(f->ctx, ids);
    *count = found;
    return *stands ? SF_OK : SF_ERR_MEMORY;
}

/* A Gaussian, in units of its standard deviations along its axes. */
typedef struct body {
    double mean[3], axes[3][3], longest; /* of the latter, world units */
} body;

static body body_of(const sf_params *p, size_t i) {
    body b = {.longest = 0};
    for (int k = 0; k < 3; k++) b.mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
    for (int axis = 0; axis < 3; axis++) {
        float direction[3];
        double scale = exp((double)*sf_value(p, SF_FIELD_log_scale, i, axis));
        sf_axis_of(p, i, axis, direction);
        for (int k = 0; k < 3; k++) b.axes[axis][k] = (double)direction[k] / scale;
        b.longest = fmax(b.longest, scale);
    }
    return b;
}

/* Whether a place is inside the Gaussian. */
static int encloses(const body *b, const double away[3]) {
    double square = 0;
    for (int axis = 0; axis < 3; axis++) {
        double along = sf_dot3(b->axes[axis], away);
        square += along * along;
    }
    return square < VEIL_REACH * VEIL_REACH;
}

/* Whether what there is of the Gaussian in a view's picture is nearer than anything may be. That is where it
 * is densest along the ray through the place in the picture that is nearest to its middle. */
static int stands_before(const body *b, const stand *s, const double away[3]) {
    const sf_camera *c = &s->camera;
    double at[3], ray[3], cross = 0, square = 0, rest = 0;
    int inside = look_at(c, b->mean, at);
    if (!(at[2] > 0) || at[2] - VEIL_FLANK * b->longest > s->nearest) return 0;
    if (inside) return at[2] < s->nearest;
    at[0] = fmin(fmax(at[0], -c->cx / c->fx), (c->width - c->cx) / c->fx);
    at[1] = fmin(fmax(at[1], -c->cy / c->fy), (c->height - c->cy) / c->fy);
    for (int k = 0; k < 3; k++) ray[k] = c->R_cw[k] * at[0] + c->R_cw[3 + k] * at[1] + c->R_cw[6 + k];
    double to[3], along[3];
    for (int axis = 0; axis < 3; axis++) {
        to[axis] = sf_dot3(b->axes[axis], away), along[axis] = sf_dot3(b->axes[axis], ray);
        cross += to[axis] * along[axis], square += along[axis] * along[axis];
    }
    double depth = cross / square;
    for (int axis = 0; axis < 3; axis++)
        rest += (to[axis] - depth * along[axis]) * (to[axis] - depth * along[axis]);
    return depth > 0 && depth < s->nearest && rest < VEIL_FLANK * VEIL_FLANK;
}

static int is_veil(const sf_fitter *f, size_t i, const stand *stands, size_t count) {
    body b = body_of(&f->model->params, i);
    /* or would have to be nearer than is drawn */
    int large = VEIL_REACH * b.longest > (double)f->near_plane;
    for (const stand *s = stands; s < stands + count; s++) {
        double away[3];
        for (int k = 0; k < 3; k++) away[k] = b.mean[k] - s->center[k];
        if (large && encloses(&b, away)) return 1;
        if (s->nearest > 0 && stands_before(&b, s, away)) return 1;
    }
    return 0;
}

sf_status sf_mark_veils(sf_fitter *f) {
    double *depths = sf_alloc(f->ctx, VEIL_SAMPLES, sizeof *depths);
    stand *stands = NULL;
    size_t count = 0;
    sf_status status = depths ? find_stands(f, depths, &stands, &count) : SF_ERR_MEMORY;
    for (size_t i = 0; i < f->model->count && !status; i++)
        if (is_veil(f, i, stands, count)) f->screen_sum[i] = -1;
    sf_free(f->ctx, stands);
    sf_free(f->ctx, depths);
    return status;
}
