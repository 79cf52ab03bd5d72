/* veil.c - what stands before a lens.
 *
 * Pictures differ in how bright they came out, and a faint Gaussian around the place that one was taken from
 * makes that picture brighter, and hardly any other. From beside it, where nobody looked, it hides the scene.
 * So no Gaussian that is charged for may have a camera inside: neither things nor the air between is such.
 */
#include "grow.h"

#include <math.h>

#include "../scene/scene.h"

/* Standard deviations from the middle of a Gaussian in which no camera may be. */
#define VEIL_REACH 2.0

/* Where the training views were taken from: *centers [*count][3], sf_free'd by the caller. */
static sf_status find_centers(const sf_fitter *f, double **centers, size_t *count) {
    uint32_t *ids;
    size_t n, found = 0;
    *centers = NULL;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &n);
    if (status) return status;
    *centers = sf_alloc(f->ctx, 3 * n, sizeof **centers);
    for (size_t k = 0; *centers && k < n; k++) {
        sf_view *view = sf_scene_retain_id(f->scene, ids[k]);
        if (!view) continue;
        sf_camera_center(&view->camera, *centers + 3 * found++);
        sf_view_release(view);
    }
    sf_free(f->ctx, ids);
    *count = found;
    return *centers ? SF_OK : SF_ERR_MEMORY;
}

/* Whether a place is inside Gaussian i, whose longest axis is `longest` long. */
static int encloses(const sf_params *p, size_t i, double longest, const double place[3]) {
    double away[3], square = 0;
    for (int k = 0; k < 3; k++) {
        away[k] = place[k] - (double)*sf_value(p, SF_FIELD_mean, i, k);
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

sf_status sf_mark_veils(sf_fitter *f) {
    const sf_params *p = &f->model->params;
    double *centers;
    size_t count;
    sf_status status = find_centers(f, &centers, &count);
    for (size_t i = 0; i < f->model->count && !status; i++) {
        double longest = 0;
        for (int k = 0; k < 3; k++)
            longest = fmax(longest, exp((double)*sf_value(p, SF_FIELD_log_scale, i, k)));
        if (!(VEIL_REACH * longest > (double)f->near_plane))
            continue; /* would have to be nearer than is drawn */
        for (size_t k = 0; k < count; k++)
            if (encloses(p, i, longest, centers + 3 * k)) {
                f->screen_sum[i] = -1;
                break;
            }
    }
    sf_free(f->ctx, centers);
    return status;
}
