/* views.c - the table of learned values of each training view. */
#include "views.h"

#include <string.h>

sf_view_state *sf_view_state_of(const sf_view_states *views, uint32_t id) {
    size_t first = 0, end = views->count;
    while (first < end) {
        size_t middle = first + (end - first) / 2;
        if (views->states[middle].id < id)
            first = middle + 1;
        else
            end = middle;
    }
    return first < views->count && views->states[first].id == id ? &views->states[first] : NULL;
}

const sf_view_lens *sf_view_lens_of(const sf_view_states *views, const sf_camera *c) {
    for (size_t i = 0; i < views->lens_count; i++) {
        const sf_view_lens *l = &views->lenses[i];
        if (l->width == c->width && l->height == c->height && l->fx == c->fx && l->fy == c->fy &&
            l->cx == c->cx && l->cy == c->cy)
            return l;
    }
    return NULL;
}

static sf_status find_lens(sf_view_states *views, sf_context *ctx, const sf_camera *c, size_t *index) {
    const sf_view_lens *found = sf_view_lens_of(views, c);
    if (found) {
        *index = (size_t)(found - views->lenses);
        return SF_OK;
    }
    sf_status status = sf_grow(ctx, &views->lenses, &views->lens_capacity, views->lens_count,
                               views->lens_count + 1, sizeof *views->lenses);
    if (status) return status;
    *index = views->lens_count++;
    views->lenses[*index] = (sf_view_lens){
        .width = c->width, .height = c->height, .fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
    return SF_OK;
}

/* Inserts the state of a view in its place: views of validation are older than others known. */
static sf_status insert(sf_view_states *views, sf_scene *scene, uint32_t id) {
    sf_view *view = sf_scene_retain_id(scene, id);
    if (!view) return SF_OK; /* removed since */
    sf_view_state state = {.id = id, .given = view->camera};
    sf_view_release(view);
    memcpy(state.R_cw, state.given.R_cw, sizeof state.R_cw);
    memcpy(state.t_cw, state.given.t_cw, sizeof state.t_cw);
    sf_status status = find_lens(views, scene->ctx, &state.given, &state.lens);
    if (status) return status;
    size_t at = views->count++;
    for (; at > 0 && views->states[at - 1].id > id; at--) views->states[at] = views->states[at - 1];
    views->states[at] = state;
    return SF_OK;
}

sf_status sf_view_states_sync(sf_view_states *views, sf_scene *scene, const uint32_t *ids, size_t count) {
    sf_status status =
        sf_grow(scene->ctx, &views->states, &views->capacity, views->count, count, sizeof *views->states);
    if (!status)
        status = sf_grow(scene->ctx, &views->scratch, &views->scratch_capacity, 0, count, sizeof(double));
    if (status) return status;
    size_t kept = 0, at = 0;
    for (size_t i = 0; i < views->count; i++) {
        while (at < count && ids[at] < views->states[i].id) at++;
        if (at < count && ids[at] == views->states[i].id) views->states[kept++] = views->states[i];
    }
    views->count = kept;
    for (size_t i = 0; i < count && !status; i++)
        if (!sf_view_state_of(views, ids[i])) status = insert(views, scene, ids[i]);
    return status;
}

sf_status sf_view_states_set_camera(sf_view_states *views, sf_context *ctx, sf_view_state *state,
                                    const sf_camera *camera) {
    sf_status status = find_lens(views, ctx, camera, &state->lens);
    if (status) return status;
    state->given = *camera;
    memcpy(state->R_cw, camera->R_cw, sizeof state->R_cw);
    memcpy(state->t_cw, camera->t_cw, sizeof state->t_cw);
    return SF_OK;
}

void sf_view_states_free(sf_view_states *views, sf_context *ctx) {
    sf_free(ctx, views->states);
    sf_free(ctx, views->lenses);
    sf_free(ctx, views->scratch);
    *views = (sf_view_states){0};
}
