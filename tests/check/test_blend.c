/* test_blend.c - blend, blend_bwd and blend_importance at every level against float64, tile by tile. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "reference/bounds.h"

/* What a list is made of. */
typedef struct kind {
    const char *name;
    double size[2];     /* px: least and most standard deviation */
    double aspect;      /* most */
    double place[2];    /* px from the tile's middle, along each axis: least and most */
    double opacity[2];  /* least and most of a uniform one ... */
    double odds_offset; /* ... or if not 0, 1 - 10^-(1 .. this) */
} kind;

static const kind kinds[] = {
    {"faint", {1, 20}, 3, {0, 12}, {0.98 / 255, 1.5 / 255}, 0},
    {"mixed", {0.1, 20}, 20, {0, 16}, {0.01, 1}, 0},
    {"dense", {1, 10}, 4, {0, 12}, {0.6, 1}, 0},
    {"saturated", {10, 200}, 2, {0, 10}, {0, 0}, 6},
    {"stack", {10, 60}, 3, {0, 12}, {0.5, 0.9}, 0},
    {"veils", {20, 100}, 2, {0, 10}, {0.02, 0.1}, 0},
    {"needles", {5, 300}, 1000, {0, 60}, {0.05, 1}, 0},
    {"off the tile", {5, 50}, 30, {16, 120}, {0.05, 1}, 0},
    {"outside", {0.1, 2}, 3, {200, 5000}, {0.05, 1}, 0},
    {"huge", {1e3, 1e6}, 100, {0, 2000}, {0.004, 0.9}, 0},
    {"tiny", {1e-4, 0.1}, 10, {0, 9}, {0.05, 1}, 0},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Around the vectors' widths, and around the lengths that lists are cut to. */
static const uint32_t counts[] = {0,   1,   2,   3,   4,   5,   7,   8,   9,   15,  16,  17,
                                  31,  32,  33,  63,  64,  65,  95,  96,  127, 128, 129, 239,
                                  240, 241, 255, 256, 257, 480, 481, 511, 512, 513, 1000};
enum { COUNTS = sizeof counts / sizeof *counts, MOST = 1000, ROUNDS = 2 };

static double signed_between(check *c, const double range[2]) {
    double value = check_between(c, range[0], range[1]);
    return check_pick(c, 2) ? value : -value;
}

static sf_splat random_splat(check *c, const kind *k, int x0, int y0) {
    double size[2], mean[2] = {x0 + 8, y0 + 8}, opacity = check_between(c, k->opacity[0], k->opacity[1]);
    size[0] = check_magnitude(c, k->size[0], k->size[1]);
    size[1] = size[0] / check_magnitude(c, 1, k->aspect);
    if (k->odds_offset > 0) opacity = 1 - pow(10, -check_between(c, 1, k->odds_offset));
    if (k->place[0] > 0) { /* along one axis at least */
        size_t axis = check_pick(c, 2);
        mean[axis] += signed_between(c, k->place);
        mean[1 - axis] += check_between(c, -k->place[1], k->place[1]);
    } else {
        for (int axis = 0; axis < 2; axis++) mean[axis] += check_between(c, -k->place[1], k->place[1]);
    }
    sf_splat s = check_splat(mean, size, check_between(c, 0, 3.1415926), opacity);
    for (int ch = 0; ch < 3; ch++) s.rgb[ch] = check_pick(c, 10) ? (float)check_between(c, 0, 1.2) : 0.0f;
    s.depth = (float)check_magnitude(c, 0.2, 100);
    return s;
}

/* A case and where its arrays are. */
typedef struct tile {
    sf_blend_args args;
    uint32_t slot_count;
    int with_depth;
    float *d_rgb[3], *weight;
    float *gradient, *worth; /* for the sums of the two */
    test_ref_tile forward;
    bounded gradient_sums[MOST][9], worth_sums[MOST][9];
} tile;

static void make_list(check *c, tile *t) {
    sf_blend_args *a = &t->args;
    const kind *k = &kinds[c->seed / 2 % KINDS];
    uint32_t n = counts[c->seed / 2 / KINDS % COUNTS];
    size_t room = ((size_t)n + 1 + SF_LANES) / SF_LANES * SF_LANES;
    a->count = n;
    a->x0 = SF_TILE * (int)check_pick(c, 100), a->y0 = SF_TILE * (int)check_pick(c, 100);
    sf_splat *splats = check_input(c, "splats", room, sizeof *splats, 64);
    uint32_t *entries = check_input(c, "entries", n, sizeof *entries, sizeof *entries);
    uint32_t *slots = check_input(c, "slots", n, sizeof *slots, sizeof *slots);
    memset(splats, 0xff, room * sizeof *splats); /* no entry is of no one's */
    t->slot_count = n + (uint32_t)check_pick(c, 5);
    for (uint32_t i = 0; i < n; i++) entries[i] = slots[i] = i;
    for (uint32_t i = n; i-- > 1;) { /* splats and slots in any order */
        uint32_t j = (uint32_t)check_pick(c, i + 1), e = entries[i], s = slots[i];
        entries[i] = entries[j], entries[j] = e;
        j = (uint32_t)check_pick(c, i + 1);
        slots[i] = slots[j], slots[j] = s;
    }
    if (n && t->slot_count > n) slots[check_pick(c, n)] = t->slot_count - 1; /* one slot stays free */
    for (uint32_t i = 0; i < n; i++) splats[entries[i]] = random_splat(c, k, a->x0, a->y0);
    a->splats = splats, a->entries = entries, a->slots = slots;
}

static void make_planes(check *c, tile *t) {
    static const char *const rgb[3] = {"red", "green", "blue"}, *const d_rgb[3] = {"d_red", "d_green",
                                                                                   "d_blue"};
    sf_blend_args *a = &t->args;
    a->stride = SF_TILE * (1 + check_pick(c, 3));
    size_t room = (SF_TILE - 1) * a->stride + SF_TILE;
    for (int ch = 0; ch < 3; ch++) {
        a->background[ch] = (float)check_between(c, 0, 1);
        a->rgb[ch] = check_floats_out(c, rgb[ch], room);
        a->d_rgb[ch] = t->d_rgb[ch] = check_floats_in(c, d_rgb[ch], room);
    }
    t->with_depth = (int)check_pick(c, 2);
    a->transmittance = check_floats_out(c, "transmittance", room);
    a->depth = t->with_depth ? check_floats_out(c, "depth", room) : NULL;
    a->last = check_output(c, "last", SF_TILE_PIXELS, sizeof *a->last, sizeof *a->last);
    a->parts = check_output(c, "parts", a->count, sizeof *a->parts, sizeof *a->parts);
    a->weight = t->weight = check_floats_in(c, "weight", room);
    t->gradient = check_floats_out(c, "sums of the gradient", (size_t)t->slot_count * SF_SUMS);
    t->worth = check_floats_out(c, "sums of worth", (size_t)t->slot_count * SF_SUMS);
}

/* Random in [least, 1) within the picture; 0 beyond it and on cliffs, so that these count for nothing. */
static void fill_plane(check *c, const tile *t, const int size[2], const uint8_t *cliff, double least,
                       float *plane) {
    for (int y = 0; y < SF_TILE; y++)
        for (size_t x = 0; x < (y + 1 < SF_TILE ? t->args.stride : SF_TILE); x++) {
            float *at = &plane[(size_t)y * t->args.stride + x];
            *at = x < SF_TILE ? 0.0f : NAN;
            if ((int)x < size[0] && y < size[1] && !cliff[y * SF_TILE + (int)x])
                *at = (float)check_between(c, least, 1);
        }
}

/* What an entry is worth has no cliff at the clamp: there, d_rgb alone is 0. */
static void make_gradient(check *c, tile *t) {
    int size[2];
    for (int axis = 0; axis < 2; axis++)
        size[axis] = check_pick(c, 3) ? SF_TILE : 1 + (int)check_pick(c, SF_TILE);
    double middle = check_pick(c, 2) ? 1 : 0;
    for (int ch = 0; ch < 3; ch++)
        fill_plane(c, t, size, t->forward.gradient_cliff, middle - 1, t->d_rgb[ch]);
    fill_plane(c, t, size, t->forward.cliff, 0, t->weight);
}

static void call_blend(const sf_kernels *kernels, void *args) { kernels->blend(args); }
static void call_blend_bwd(const sf_kernels *kernels, void *args) { kernels->blend_bwd(args); }
static void call_blend_importance(const sf_kernels *kernels, void *args) { kernels->blend_importance(args); }

static void compare_plane(check *c, const tile *t, const char *what, const float *got, const bounded *want) {
    for (int px = 0; px < SF_TILE_PIXELS; px++)
        if (!t->forward.cliff[px])
            check_near(c, what, (size_t)px,
                       (double)got[(size_t)(px / SF_TILE) * t->args.stride + px % SF_TILE], want[px]);
    for (size_t y = 0; y + 1 < SF_TILE; y++)
        check_that(
            c, check_untouched(got + y * t->args.stride + SF_TILE, (t->args.stride - SF_TILE) * sizeof *got),
            "wrote beside the tile", y);
}

static void compare_picture(check *c, const tile *t) {
    const sf_blend_args *a = &t->args;
    for (int ch = 0; ch < 3; ch++) compare_plane(c, t, "rgb", a->rgb[ch], t->forward.rgb[ch]);
    compare_plane(c, t, "transmittance", a->transmittance, t->forward.transmittance);
    if (t->with_depth) compare_plane(c, t, "depth", a->depth, t->forward.depth);
    for (int px = 0; px < SF_TILE_PIXELS; px++) check_cliffs(c, t->forward.cliff[px]);
}

static const char *const gradient_names[] = {"sum w dr", "sum w dg",  "sum w db",  "sum p",    "sum p t",
                                             "sum p s",  "sum p t^2", "sum p t s", "sum p s^2"};
static const char *const worth_names[SF_IMPORTANCE_SUMS] = {
    "sum w dr", "sum w dg", "sum w db", "sum D . d", "sum m |D|^2", "sum m w^2", "sum w |d|^2", "sum m w"};

/* The first `count` sums of each slot. */
static void compare_sums(check *c, const tile *t, const float *got, bounded (*want)[9],
                         const char *const *names, int count) {
    static uint8_t taken[MOST + 8];
    const sf_blend_args *a = &t->args;
    memset(taken, 0, sizeof taken);
    for (uint32_t e = 0; e < a->count; e++) {
        taken[a->slots[e]] = 1;
        for (int k = 0; k < count; k++)
            check_near(c, names[k], e, (double)got[(size_t)a->slots[e] * SF_SUMS + (size_t)k], want[e][k]);
    }
    for (uint32_t slot = 0; slot < t->slot_count; slot++)
        check_that(c, taken[slot] || check_untouched(got + (size_t)slot * SF_SUMS, SF_SUMS * sizeof *got),
                   "wrote into a slot of no entry", slot);
}

/* Of all cases: each branch must have been there. */
static uint64_t pairs, saturated, stopped;

static void blend_case(check *c) {
    static tile t;
    make_list(c, &t);
    make_planes(c, &t);
    test_ref_blend_tile(&t.args, &t.forward);
    make_gradient(c, &t);
    test_ref_blend_tile_backward(&t.args, &t.forward, t.gradient_sums);
    test_ref_blend_tile_worth(&t.args, &t.forward, t.worth_sums);
    pairs += t.forward.pairs, saturated += t.forward.saturated, stopped += t.forward.stopped;
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!check_call(c, 0, call_blend, &t.args)) continue;
        compare_picture(c, &t);
        t.args.sums = t.gradient;
        if (check_call(c, 1, call_blend_bwd, &t.args))
            compare_sums(c, &t, t.gradient, t.gradient_sums, gradient_names, 9);
        t.args.sums = t.worth;
        if (check_call(c, 2, call_blend_importance, &t.args))
            compare_sums(c, &t, t.worth, t.worth_sums, worth_names, SF_IMPORTANCE_SUMS);
    }
}

static void blend_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernels[] = {{"blend", SF_KERNEL_blend},
                                           {"blend_bwd", SF_KERNEL_blend_bwd},
                                           {"blend_importance", SF_KERNEL_blend_importance}};
    check_kernels(kernels, 3, 2 * KINDS * COUNTS * ROUNDS, blend_case);
    print_message("%llu pairs, %llu saturated, %llu pixels stopped\n", (unsigned long long)pairs,
                  (unsigned long long)saturated, (unsigned long long)stopped);
    if (!getenv("SPLATFIT_SEED")) assert_true(pairs > 100000 && saturated > 1000 && stopped > 1000);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(blend_agrees_with_float64)};
    return cmocka_run_group_tests_name("check blend", tests, NULL, NULL);
}
