/* online.c - see online.h. */
#include "online.h"

#include "fitter.h"
#include "moving_average.h"
#include "options.h"
#include "refine.h"
#include "restore_point.h"
#include "select_merge.h"

sf_status sf_online_check(sf_context *ctx, const sf_fit_options *options) {
    return sf_fit_options_check(ctx, options);
}

int sf_online_has_view(const sf_fitter *f, uint32_t id) { return sf_view_state_of(&f->views, id) != NULL; }

sf_status sf_online_set_camera(sf_fitter *f, uint32_t id, const sf_camera *camera) {
    sf_view_state *state = sf_view_state_of(&f->views, id);
    return state ? sf_view_states_set_camera(&f->views, f->ctx, state, camera) : SF_OK;
}

void sf_online_refine_camera(const sf_fitter *f, uint32_t id, sf_camera *camera) {
    sf_refine_camera(&f->views, id, camera);
}

double sf_online_near_plane(const sf_fitter *f) {
    return f->near_plane > 0 ? (double)f->near_plane : 0.04 * f->extent;
}

double sf_online_extent(const sf_fitter *f) { return f->extent; }

const sf_model *sf_online_model(sf_fitter *f, sf_render_options *options) {
    sf_fitter_render_options(f, options);
    options->sh_degree = f->sh_degree;
    return sf_fitter_average_model(f);
}

sf_status sf_online_draw(sf_fitter *f, const sf_camera *camera, const sf_workspace **drawing) {
    sf_render_options options;
    sf_fitter_render_options(f, &options);
    *drawing = &f->workspace;
    return sf_forward(&f->workspace, sf_fitter_average_model(f), camera, &options, 1);
}

void sf_online_move_means(sf_fitter *f, void (*move)(sf_model *model, void *user), void *user) {
    sf_merges_undo_all(f);
    move(f->model, user);
    if (sf_expand_restore_point(f))
        sf_drop_restore_point(f); /* no memory: none is better than one elsewhere */
    if (f->restore.model) move(f->restore.model, user);
}
