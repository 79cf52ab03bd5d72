/* sample_views.c - renders a sample of the training views between two steps, to measure them. */
#include "sample_views.h"

#include <math.h>

#include "draw_view.h"
#include "schedule.h"

static sf_status measure_view(sf_fitter *f, uint32_t id, sf_sample_fn measure, void *user) {
    sf_view *view = sf_scene_retain_id(f->scene, id);
    if (!view) return SF_OK; /* removed since */
    sf_view_state *state = sf_view_state_of(&f->views, id);
    double weight_sum;
    int level = f->level;
    f->level = sf_level_within(level, view->camera.width, view->camera.height);
    double pixels = ldexp(1, 2 * f->level);
    sf_status status = sf_draw_view(f, view, state, &weight_sum);
    f->level = level;
    status = status ? (status == SF_ERR_EMPTY ? SF_OK : status) : measure(f, state, pixels, weight_sum, user);
    sf_view_release(view);
    return status;
}

/* Whether the view is there and not wholly masked. */
static int is_usable(const sf_fitter *f, uint32_t id) {
    sf_view *view = sf_scene_retain_id(f->scene, id);
    if (!view) return 0; /* removed since */
    int hidden = sf_view_is_hidden(view);
    sf_view_release(view);
    return !hidden;
}

sf_status sf_sample_views(sf_fitter *f, size_t wanted, int others, sf_sample_fn measure, void *user,
                          size_t *there) {
    uint32_t *ids;
    size_t n, kept = 0;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &n);
    if (status) return status;
    for (size_t i = 0; i < n; i++)
        if (!sf_is_in_validation(&f->validation, ids[i]) && is_usable(f, ids[i])) ids[kept++] = ids[i];
    if (there) *there = kept;
    if (!wanted || wanted > kept) wanted = kept;
    double shift = 0;
    if (others && wanted < kept) /* densify_every is 0 in a fitter that only measures */
        shift = fmod(SF_GOLDEN * (double)(f->step / f->options.densify_every), 1);
    for (size_t k = 0; k < wanted && !status; k++) {
        size_t at = (size_t)(((double)k + shift) * (double)kept / (double)wanted);
        status = measure_view(f, ids[at < kept ? at : kept - 1], measure, user);
    }
    sf_free(f->ctx, ids);
    return status;
}
