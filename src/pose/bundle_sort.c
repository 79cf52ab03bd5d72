/* bundle_sort.c - the memory of a bundle adjustment: observations by point and by view, columns of lenses. */
#include <string.h>

#include "bundle_equations.h"

/* What of the cameras is free. */
static void make_columns(sf_bundle_work *a) {
    for (size_t i = 0; i < a->b->camera_count; i++) {
        const sf_bundle_camera *camera = &a->b->cameras[i];
        sf_bundle_columns *c = &a->columns[i];
        const int is_free[SF_LENS_PARAMETERS] = {camera->focal > 0,  camera->focal > 1,  camera->center,
                                                 camera->center,     camera->radial > 0, camera->radial > 1,
                                                 camera->tangential, camera->tangential};
        *c = (sf_bundle_columns){.is_tied = camera->focal == 1,
                                 .aspect = camera->lens.fy / camera->lens.fx,
                                 .first = a->eq.lens_columns};
        for (int k = 0; k < SF_LENS_PARAMETERS; k++)
            if (is_free[k]) c->which[c->count++] = k;
        a->eq.lens_columns += (size_t)c->count;
    }
}

/* The slots of all points: marks [cameras] tells the last point that each camera was seen in. `slots` NULL:
 * counts them. */
static size_t fill_slots(const sf_bundle_work *a, size_t *marks, size_t *of_camera, sf_bundle_slot *slots) {
    size_t count = 0;
    for (size_t i = 0; i < a->b->camera_count; i++) marks[i] = SIZE_MAX;
    for (size_t point = 0; point < a->b->point_count; point++) {
        if (slots) a->first_slot[point] = count;
        for (size_t i = a->first[point]; i < a->first[point + 1]; i++) {
            uint32_t camera = a->b->views[a->b->observations[i].view].camera;
            if (marks[camera] != point) {
                marks[camera] = point, of_camera[camera] = count;
                if (slots) slots[count].camera = camera, slots[count].point = (uint32_t)point;
                count++;
            }
            if (slots) a->slot_of[i] = (uint32_t)of_camera[camera];
        }
    }
    if (slots) a->first_slot[a->b->point_count] = count;
    return count;
}

/* And which are those of each camera. */
static void sort_slots(sf_bundle_work *a, size_t count) {
    for (size_t i = 0; i < count; i++) a->camera_from[a->slots[i].camera + 2]++;
    for (size_t i = 2; i < a->b->camera_count + 2; i++) a->camera_from[i] += a->camera_from[i - 1];
    for (size_t i = 0; i < count; i++) a->camera_slots[a->camera_from[a->slots[i].camera + 1]++] = i;
}

static int make_slots(sf_bundle_work *a) {
    size_t cameras = a->b->camera_count;
    if (!a->eq.lens_columns) return 1;
    size_t *marks = sf_alloc(a->ctx, 2 * cameras, sizeof *marks);
    size_t count = marks ? fill_slots(a, marks, marks + cameras, NULL) : 0;
    a->slots = sf_alloc(a->ctx, count + 1, sizeof *a->slots);
    a->first_slot = sf_alloc(a->ctx, a->b->point_count + 1, sizeof *a->first_slot);
    a->slot_of = sf_alloc(a->ctx, a->b->observation_count + 1, sizeof *a->slot_of);
    a->camera_slots = sf_alloc(a->ctx, count + 1, sizeof *a->camera_slots);
    a->camera_from = sf_calloc(a->ctx, cameras + 2, sizeof *a->camera_from);
    int ready = marks && a->slots && a->first_slot && a->slot_of && a->camera_slots && a->camera_from;
    if (ready) {
        fill_slots(a, marks, marks + cameras, a->slots);
        sort_slots(a, count);
    }
    sf_free(a->ctx, marks);
    return ready;
}

/* Where the observations of each point begin, and which are those of each free view. */
static void sort_observations(sf_bundle_work *a) {
    const sf_bundle *b = a->b;
    for (size_t i = 0; i < b->observation_count; i++) {
        size_t rank = a->rank[b->observations[i].view];
        a->rank_of[i] = rank == SIZE_MAX ? UINT32_MAX : (uint32_t)rank;
        a->first[b->observations[i].point + 1]++;
        if (rank != SIZE_MAX) a->from[rank + 2]++;
    }
    for (size_t i = 1; i <= b->point_count; i++) a->first[i] += a->first[i - 1];
    for (size_t i = 2; i <= a->free_count + 1; i++) a->from[i] += a->from[i - 1];
    for (size_t i = 0; i < b->observation_count; i++)
        if (a->rank_of[i] != UINT32_MAX) {
            uint32_t point = b->observations[i].point;
            size_t end = a->first[point + 1];
            while (a->rank_of[end - 1] > a->rank_of[i]) end--; /* those of the row alone are read */
            a->of_view[a->from[a->rank_of[i] + 1]++] =
                (sf_bundle_row_entry){(uint32_t)i, point, (uint32_t)a->first[point], (uint32_t)end};
        }
}

static int make_room(sf_bundle_work *a) {
    const sf_bundle *b = a->b;
    sf_context *ctx = a->ctx;
    a->first = sf_calloc(ctx, b->point_count + 1, sizeof *a->first);
    a->of_view = sf_alloc(ctx, b->observation_count + 1, sizeof *a->of_view);
    a->from = sf_calloc(ctx, a->free_count + 2, sizeof *a->from);
    a->rank_of = sf_alloc(ctx, b->observation_count + 1, sizeof *a->rank_of);
    a->Z = sf_alloc(ctx, b->observation_count + 1, sizeof *a->Z);
    a->sums = sf_alloc(ctx, b->point_count + 1, sizeof *a->sums);
    a->view_sums = sf_alloc(ctx, SF_BUNDLE_GROUPS * a->free_count + 1, sizeof *a->view_sums);
    a->camera_sums = sf_alloc(ctx, SF_BUNDLE_GROUPS * b->camera_count + 1, sizeof *a->camera_sums);
    a->poses = sf_alloc(ctx, b->view_count + 1, sizeof *a->poses);
    a->cameras = sf_alloc(ctx, b->camera_count + 1, sizeof *a->cameras);
    a->at = sf_alloc(ctx, 6 * b->point_count + 1, sizeof *a->at);
    a->distances = sf_alloc(ctx, b->observation_count + 1, sizeof *a->distances);
    a->finite = sf_alloc(ctx, b->observation_count + 1, sizeof *a->finite);
    return a->first && a->of_view && a->from && a->rank_of && a->Z && a->sums && a->view_sums &&
           a->camera_sums && a->poses && a->cameras && a->at && a->distances && a->finite;
}

int sf_bundle_work_make(sf_bundle_work *a) {
    const sf_bundle *b = a->b;
    a->rank = sf_alloc(a->ctx, b->view_count + 1, sizeof *a->rank);
    a->view_of = sf_alloc(a->ctx, b->view_count + 1, sizeof *a->view_of);
    a->columns = sf_alloc(a->ctx, b->camera_count + 1, sizeof *a->columns);
    if (!a->rank || !a->view_of || !a->columns) return 0;
    for (size_t i = 0; i < b->view_count; i++) {
        a->rank[i] = b->views[i].is_free ? a->free_count : SIZE_MAX;
        if (b->views[i].is_free) a->view_of[a->free_count++] = i;
    }
    if (!make_room(a)) return 0;
    make_columns(a);
    sort_observations(a);
    return make_slots(a) && sf_bundle_equations_make(a);
}

void sf_bundle_work_free(sf_bundle_work *a) {
    void *const blocks[] = {
        a->rank,      a->view_of, a->columns,   a->first,      a->of_view, a->from,         a->rank_of,
        a->Z,         a->sums,    a->view_sums, a->poses,      a->cameras, a->camera_sums,  a->at,
        a->distances, a->finite,  a->slots,     a->first_slot, a->slot_of, a->camera_slots, a->camera_from};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(a->ctx, blocks[i]);
    sf_bundle_equations_free(a->ctx, &a->eq);
}
