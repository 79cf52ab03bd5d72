/* test_project.c - project and project_bwd at every level against float64. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "reference/bounds.h"

enum kind { PLAIN, NEEDLES, PLATES, HUGE_ONES, SPECKS, BESIDE, NEAR, FAINT, WIDE, LONG_LENS, STRANGE, KINDS };
enum { DEGREES = 4, ROUNDS = 4, MOST = 5 * SF_LANES };

static const char *const field_names[SF_FIELD_COUNT] = {
#define NAME(name, components) "d_" #name,
    SF_FIELDS(NAME)
#undef NAME
};
static const char *const splat_names[16] = {
    "u",   "v",     "l00",   "l01",   "m",       "log2_opacity", "rgb",        "rgb",
    "rgb", "depth", "slope", "reach", "squeeze", "lean",         "half_width", "half_height"};
static const int components[SF_FIELD_COUNT] = {
#define COMPONENTS(name, count) count,
    SF_FIELDS(COMPONENTS)
#undef COMPONENTS
};

/* Inputs, the outputs' places, and the blocks that are asked for. */
typedef struct scene {
    enum kind kind;
    sf_eye eye;
    size_t count, first, end; /* Gaussians; blocks */
    int stored_degree;
    sf_project_args args;
    float *params[SF_FIELD_COUNT];
    sf_project_bwd_args bwd;
    int with_camera, bad_sums;
} scene;

static void make_eye(check *c, scene *s) {
    sf_eye *e = &s->eye;
    double q[4], norm = 0, longest;
    for (int k = 0; k < 4; k++) norm += pow(q[k] = sf_rng_normal(&c->rng), 2);
    for (int k = 0; k < 4; k++) q[k] /= sqrt(norm);
    double w = q[0], x = q[1], y = q[2], z = q[3];
    const double R[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                         2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                         2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    *e = (sf_eye){.width = 1 + (int)check_pick(c, 400),
                  .height = 1 + (int)check_pick(c, 300),
                  .near_plane = 0.2f,
                  .low_pass = check_pick(c, 2) ? SF_LOW_PASS : check_between(c, 0.05, 0.5)};
    longest = e->width > e->height ? e->width : e->height;
    if (s->kind == LONG_LENS) longest *= 20;
    e->fx = (float)(longest * check_between(c, 0.5, 1.5)),
    e->fy = (float)(longest * check_between(c, 0.5, 1.5));
    e->cx = (float)(e->width * check_between(c, 0.4, 0.6)),
    e->cy = (float)(e->height * check_between(c, 0.4, 0.6));
    e->clamp_x = 1.3f * (float)e->width / (2 * e->fx), e->clamp_y = 1.3f * (float)e->height / (2 * e->fy);
    e->tiles_x = (e->width + SF_TILE - 1) / SF_TILE, e->tiles_y = (e->height + SF_TILE - 1) / SF_TILE;
    for (int k = 0; k < 9; k++) e->R[k] = (float)R[k];
    for (int k = 0; k < 3; k++) e->t[k] = (float)check_between(c, -3, 3);
    for (int k = 0; k < 3; k++)
        e->center[k] = -(e->R[k] * e->t[0] + e->R[3 + k] * e->t[1] + e->R[6 + k] * e->t[2]);
}

static float *param(const scene *s, int field, size_t i, int k) {
    return &s->params[field][sf_at(i, components[field], k)];
}

/* In the camera's frame; on the screen +-place half pictures from the middle. */
static double put(check *c, const scene *s, size_t i, double place) {
    const sf_eye *e = &s->eye;
    double z = s->kind == NEAR ? check_between(c, -0.1, 0.6) : check_magnitude(c, 0.21, 30), p[3];
    if (s->kind == LONG_LENS) z = check_magnitude(c, 2, 100);
    p[0] = z * check_between(c, -place, place) * e->width / (2 * (double)e->fx) - (double)e->t[0];
    p[1] = z * check_between(c, -place, place) * e->height / (2 * (double)e->fy) - (double)e->t[1];
    p[2] = z - (double)e->t[2];
    for (int k = 0; k < 3; k++)
        *param(s, SF_FIELD_mean, i, k) =
            (float)((double)e->R[k] * p[0] + (double)e->R[3 + k] * p[1] + (double)e->R[6 + k] * p[2]);
    return z;
}

/* Standard deviations in pixels at the middle, least and most of each axis. */
static void make_gaussian(check *c, const scene *s, size_t i) {
    static const double sizes[KINDS][3][2] = {
        [PLAIN] = {{0.3, 30}, {0.3, 30}, {0.3, 30}},
        [NEEDLES] = {{30, 300}, {0.03, 0.3}, {0.03, 0.3}},
        [PLATES] = {{10, 60}, {10, 60}, {0.01, 0.02}},
        [HUGE_ONES] = {{100, 1e5}, {100, 1e5}, {100, 1e5}},
        [SPECKS] = {{1e-4, 0.5}, {1e-4, 0.5}, {1e-4, 0.5}},
        [BESIDE] = {{1, 50}, {1, 50}, {1, 50}},
        [NEAR] = {{1, 100}, {1, 100}, {1, 100}},
        [FAINT] = {{0.5, 20}, {0.5, 20}, {0.5, 20}},
        [WIDE] = {{200, 2000}, {20, 2000}, {2, 2000}},
        [LONG_LENS] = {{30, 300}, {0.03, 30}, {0.03, 0.3}},
        [STRANGE] = {{0.3, 30}, {0.3, 30}, {0.3, 30}},
    };
    static const double places[KINDS] = {
        [PLAIN] = 1.2, [NEEDLES] = 1.5, [PLATES] = 1.2, [HUGE_ONES] = 3, [SPECKS] = 1.1, [BESIDE] = 8,
        [NEAR] = 2,    [FAINT] = 1.1,   [WIDE] = 4,     [LONG_LENS] = 1, [STRANGE] = 1};
    double z = put(c, s, i, places[s->kind]), scale = check_magnitude(c, 1e-3, 1e3);
    for (int k = 0; k < 3; k++) {
        double px = check_magnitude(c, sizes[s->kind][k][0], sizes[s->kind][k][1]);
        *param(s, SF_FIELD_log_scale, i, k) = (float)log(px * fmax(fabs(z), 0.1) / (double)s->eye.fx);
    }
    for (int k = 0; k < 4; k++) *param(s, SF_FIELD_quat, i, k) = (float)(scale * sf_rng_normal(&c->rng));
    double faint = log(1 / 254.0) + check_between(c, -0.01, 0.3);
    *param(s, SF_FIELD_logit_opacity, i, 0) =
        (float)(s->kind == FAINT ? faint : check_between(c, -6, check_pick(c, 4) ? 6 : 40));
    for (int field = SF_FIELD_sh0; field < SF_FIELD_COUNT; field++)
        for (int k = 0; s->params[field] && k < components[field]; k++)
            *param(s, field, i, k) = (float)(0.5 * sf_rng_normal(&c->rng));
}

/* One parameter with a value that no fit should reach. */
static void spoil(check *c, const scene *s, size_t i) {
    static const float values[] = {NAN,     INFINITY, -INFINITY, 1e38f, -1e38f, 1e-40f,
                                   -1e-40f, 0,        100,       -100,  1e4f,   -1e4f};
    int field;
    do field = (int)check_pick(c, SF_FIELD_COUNT);
    while (!s->params[field]);
    float value = values[check_pick(c, sizeof values / sizeof *values)];
    int whole = check_pick(c, 4) == 0; /* a quaternion of nothing, for one */
    for (int k = 0; k < components[field]; k++)
        if (whole || k == (int)(i % (size_t)components[field])) *param(s, field, i, k) = value;
}

static void make_gaussians(check *c, scene *s) {
    static const char *const names[SF_FIELD_COUNT] = {
#define NAME(name, components) #name,
        SF_FIELDS(NAME)
#undef NAME
    };
    size_t blocks = 1 + check_pick(c, MOST / SF_LANES);
    s->count = blocks * SF_LANES;
    s->first = check_pick(c, blocks);
    s->end = s->first + 1 + check_pick(c, blocks - s->first);
    s->args = (sf_project_args){.eye = &s->eye, .sh_degree = (int)(c->seed / 2 / KINDS % DEGREES)};
    s->args.antialiased = (int)(c->seed / 2 / KINDS / DEGREES % 2);
    s->stored_degree = s->args.sh_degree + (int)check_pick(c, (size_t)(DEGREES - s->args.sh_degree));
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        s->params[field] = NULL;
        if (field - SF_FIELD_sh0 > s->stored_degree) continue;
        s->params[field] = check_floats_in(c, names[field], s->count * (size_t)components[field]);
        s->args.params.field[field] = s->params[field];
    }
    for (size_t i = 0; i < s->count; i++) {
        make_gaussian(c, s, i);
        if (s->kind == STRANGE) spoil(c, s, i);
    }
    s->args.splats = check_output(c, "splats", s->count, sizeof(sf_splat), 64);
    s->args.state = check_output(c, "state", s->count, 1, 1);
    s->args.first_row = check_output(c, "first_row", s->count, sizeof(uint16_t), sizeof(uint16_t));
    s->args.rows = check_output(c, "rows", s->count, sizeof(uint16_t), sizeof(uint16_t));
}

/* Up to three slots a Gaussian; what lies behind the nine sums is no number. */
static void make_sums(check *c, scene *s) {
    static const float bad[] = {NAN, INFINITY, 3e38f, 1e30f};
    uint32_t *slot = check_input(c, "slot", s->count + 1, sizeof *slot, sizeof *slot);
    for (size_t i = 0; i < s->count; i++) slot[i + 1] = slot[i] + (uint32_t)check_pick(c, 4);
    uint32_t slots = slot[s->count];
    float *sums = check_floats_in(c, "sums", (size_t)slots * SF_SUMS);
    s->bad_sums = check_pick(c, 5) == 0;
    for (uint32_t n = 0; n < slots; n++) {
        double size = check_magnitude(c, 1e-6, 10);
        for (int k = 0; k < SF_SUMS; k++)
            sums[n * SF_SUMS + (uint32_t)k] = k < 9 ? (float)(size * sf_rng_normal(&c->rng)) : NAN;
        if (s->bad_sums && check_pick(c, 10) == 0)
            sums[n * SF_SUMS + check_pick(c, 9)] = bad[check_pick(c, 4)];
    }
    s->bwd = (sf_project_bwd_args){.slot = slot, .sums = sums};
}

static void make_outputs(check *c, scene *s) {
    size_t lanes = (s->end - s->first) * SF_LANES;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        if (s->params[field])
            s->bwd.grads.field[field] =
                check_floats_out(c, field_names[field], lanes * (size_t)components[field]);
    s->with_camera = (int)check_pick(c, 2);
    s->bwd.screen = check_floats_out(c, "screen", s->count);
    if (s->with_camera)
        s->bwd.camera = check_output(c, "camera", SF_CAMERA_SUMS, sizeof(double), sizeof(double));
    s->bwd.not_finite = check_output(c, "not_finite", 1, sizeof(unsigned), sizeof(unsigned));
    s->bwd.forward = s->args;
}

static void call_project(const sf_kernels *kernels, void *args) {
    scene *s = args;
    kernels->project(&s->args, s->first, s->end);
}

static void call_project_bwd(const sf_kernels *kernels, void *args) {
    scene *s = args;
    kernels->project_bwd(&s->bwd, s->first, s->end);
}

static void compare_seen(check *c, const scene *s, size_t i, const test_ref_seen *want) {
    const float *got = (const float *)(const void *)&s->args.splats[i];
    int seen = s->args.state[i] == SF_SEEN;
    if (want->open) {
        check_cliffs(c, 1);
        check_that(c, s->args.state[i] <= SF_NOT_FINITE, "the state is none", i);
    } else {
        check_that(c, s->args.state[i] == want->state, "the state is another", i);
    }
    if (!seen) check_that(c, s->args.rows[i] == 0, "rows of what is not seen", i);
    if (!seen || want->open || want->state != SF_SEEN) return;
    for (int k = 0; k < 16; k++) check_near(c, splat_names[k], i, (double)got[k], want->splat[k]);
    int first = s->args.first_row[i], end = first + s->args.rows[i];
    check_that(
        c, want->needed_end <= want->needed_first || (first <= want->needed_first && end >= want->needed_end),
        "a row of tiles is missing", i);
    check_that(c, first >= want->allowed_first && end <= want->allowed_end, "a row of tiles too many", i);
}

static void compare_forward(check *c, const scene *s, const test_ref_seen *want) {
    for (size_t i = 0; i < s->count; i++) {
        if (i / SF_LANES >= s->first && i / SF_LANES < s->end) {
            compare_seen(c, s, i, &want[i]);
            continue;
        }
        check_that(c,
                   check_untouched(&s->args.splats[i], sizeof *s->args.splats) &&
                       check_untouched(&s->args.state[i], 1) &&
                       check_untouched(&s->args.rows[i], sizeof(uint16_t)) &&
                       check_untouched(&s->args.first_row[i], sizeof(uint16_t)),
                   "wrote into a block that was not asked for", i);
    }
}

static void compare_gradient(check *c, const scene *s, size_t i, const test_ref_raw_gradient *want) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int k = 0; s->params[field] && k < components[field]; k++)
            check_near(
                c, field_names[field], i,
                (double)s->bwd.grads.field[field][sf_at(i - s->first * SF_LANES, components[field], k)],
                want->field[field][k]);
    check_near(c, "screen", i, (double)s->bwd.screen[i], want->screen);
}

enum { NOT_FINITE_BEFORE = 7 };

static void compare_backward(check *c, const scene *s, const test_ref_seen *seen) {
    bounded camera[SF_CAMERA_SUMS];
    unsigned left_out = 0;
    int open = 0;
    for (int k = 0; k < SF_CAMERA_SUMS; k++) camera[k] = b_of(k - 2.5);
    for (size_t i = 0; i < s->count; i++) {
        if (i / SF_LANES < s->first || i / SF_LANES >= s->end) {
            check_that(c, check_untouched(&s->bwd.screen[i], sizeof(float)),
                       "wrote into another block's screen", i);
            continue;
        }
        test_ref_raw_gradient want = {.open = 0};
        if (s->args.state[i] == SF_SEEN) {
            double sums[9] = {0};
            for (uint32_t n = s->bwd.slot[i]; n < s->bwd.slot[i + 1]; n++)
                for (int k = 0; k < 9; k++) sums[k] += (double)s->bwd.sums[n * SF_SUMS + (uint32_t)k];
            test_ref_unsee(&s->args, i, sums, &want);
            want.open |= seen[i].open;
        }
        left_out += (unsigned)want.not_finite;
        open |= want.open;
        if (want.open) {
            check_cliffs(c, 1);
            continue;
        }
        compare_gradient(c, s, i, &want);
        for (int k = 0; k < SF_CAMERA_SUMS; k++)
            camera[k] = b_widen(b_add(camera[k], want.camera[k]), 1e-12 * fabs(want.camera[k].v));
    }
    if (open) return;
    for (size_t k = 0; s->with_camera && k < SF_CAMERA_SUMS; k++)
        check_near(c, k < 6 ? "pose" : "focal", k, s->bwd.camera[k], camera[k]);
    check_that(c, *s->bwd.not_finite == NOT_FINITE_BEFORE + left_out, "another number is not finite",
               *s->bwd.not_finite);
}

static size_t seen_count, unseen_count, left_count;

static void project_case(check *c) {
    static scene s;
    static test_ref_seen want[MOST];
    memset(&s, 0, sizeof s);
    s.kind = (enum kind)(c->seed / 2 % KINDS);
    make_eye(c, &s);
    make_gaussians(c, &s);
    make_sums(c, &s);
    make_outputs(c, &s);
    for (size_t i = 0; i < s.count; i++) {
        test_ref_see(&s.args, i, &want[i]);
        seen_count += want[i].state == SF_SEEN;
        unseen_count += want[i].state == SF_OUT_OF_VIEW;
        left_count += want[i].state == SF_NOT_FINITE;
    }
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!check_call(c, 0, call_project, &s)) continue;
        compare_forward(c, &s, want);
        for (int k = 0; s.with_camera && k < SF_CAMERA_SUMS; k++) s.bwd.camera[k] = k - 2.5;
        *s.bwd.not_finite = NOT_FINITE_BEFORE;
        if (check_call(c, 1, call_project_bwd, &s)) compare_backward(c, &s, want);
    }
}

static void project_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernels[] = {{"project", SF_KERNEL_project},
                                           {"project_bwd", SF_KERNEL_project_bwd}};
    check_kernels(kernels, 2, 2 * KINDS * DEGREES * 2 * ROUNDS, project_case);
    print_message("%zu seen, %zu out of view, %zu not finite\n", seen_count, unseen_count, left_count);
    if (!getenv("SPLATFIT_SEED")) assert_true(seen_count > 1000 && unseen_count > 500 && left_count > 100);
}

/* ---- the values that the bounds stand beside ------------------------------------------------------------
 */

/* The same Gaussian through the reference of the golden cases, which shares no formula for the covariance's
 * inverse and its gradient with test_ref_see and test_ref_unsee. */
static void to_reference(const scene *s, test_ref_scene *r) {
    const sf_eye *e = &s->eye;
    r->camera = (sf_camera){.width = e->width,
                            .height = e->height,
                            .fx = (double)e->fx,
                            .fy = (double)e->fy,
                            .cx = (double)e->cx,
                            .cy = (double)e->cy};
    for (int k = 0; k < 9; k++) r->camera.R_cw[k] = (double)e->R[k];
    for (int k = 0; k < 3; k++) r->camera.t_cw[k] = (double)e->t[k];
    r->near_plane = (double)e->near_plane;
    r->low_pass = e->low_pass;
    r->antialiased = s->args.antialiased;
    r->sh_degree = s->args.sh_degree;
    r->count = s->count;
    r->gaussians = test_ref_gaussians_create(s->count, r->sh_degree);
    test_ref_array list[TEST_REF_ARRAYS];
    test_ref_list(&r->gaussians, r->sh_degree, list);
    for (size_t i = 0; i < s->count; i++) {
        for (int k = 0; k < 3; k++) {
            r->gaussians.means[3 * i + (size_t)k] = (double)*param(s, SF_FIELD_mean, i, k);
            r->gaussians.log_scales[3 * i + (size_t)k] = (double)*param(s, SF_FIELD_log_scale, i, k);
        }
        for (int k = 0; k < 4; k++)
            r->gaussians.quats[4 * i + (size_t)k] = (double)*param(s, SF_FIELD_quat, i, k);
        r->gaussians.logit_opacities[i] = (double)*param(s, SF_FIELD_logit_opacity, i, 0);
        double *sh = r->gaussians.sh + 3 * i * (size_t)((r->sh_degree + 1) * (r->sh_degree + 1));
        for (int field = SF_FIELD_sh0; field - SF_FIELD_sh0 <= r->sh_degree; field++)
            for (int k = 0; k < components[field]; k++) *sh++ = (double)*param(s, field, i, k);
    }
}

/* The sums' moments, from t and s back to offsets in pixels. */
static test_ref_splat_grads unwhiten(const test_ref_splat *p, const double *sums) {
    double l00 = SF_WHITEN * sqrt(p->cov2d[2] / p->det), m = SF_WHITEN / sqrt(p->cov2d[2]);
    double l01 = -SF_WHITEN * p->cov2d[1] / sqrt(p->cov2d[2] * p->det), k = -l01 / (l00 * m);
    double xx = (sums[6] / l00 + sums[7] * k) / l00 + (sums[7] / l00 + sums[8] * k) * k;
    double xy = (sums[7] / l00 + sums[8] * k) / m, yy = sums[8] / (m * m);
    return (test_ref_splat_grads){
        .mean2d = {SF_WHITEN_UNDO * l00 * sums[4], SF_WHITEN_UNDO * (l01 * sums[4] + m * sums[5])},
        .conic = {-xx / 2, -xy, -yy / 2},
        .rgb = {sums[0], sums[1], sums[2]},
        .opacity = sums[3] / p->opacity};
}

static double difference(const double *a, const bounded *b, size_t n) {
    double worst = 0, largest = 0;
    for (size_t k = 0; k < n; k++) {
        worst = fmax(worst, fabs(a[k] - b[k].v));
        largest = fmax(largest, fabs(a[k]));
    }
    return largest > 0 ? worst / largest : worst;
}

static double against_reference(check *c, const scene *s, const test_ref_scene *r, size_t i) {
    test_ref_seen seen;
    test_ref_raw_gradient got;
    test_ref_splat splat;
    test_ref_grads grads = {.gaussians = test_ref_gaussians_create(s->count, r->sh_degree)};
    double sums[9], worst = 0;
    for (int k = 0; k < 9; k++) sums[k] = sf_rng_normal(&c->rng);
    test_ref_see(&s->args, i, &seen);
    test_ref_project(r, i, &splat);
    assert_int_equal(splat.visible, s->kind != NEAR || splat.visible);
    if (seen.state == SF_SEEN && !seen.open) {
        test_ref_splat_grads d = unwhiten(&splat, sums);
        test_ref_project_backward(r, i, &d, &grads);
        test_ref_unsee(&s->args, i, sums, &got);
        const double mean[2] = {splat.mean2d[0], splat.mean2d[1]};
        worst = fmax(difference(mean, seen.splat, 2), difference(splat.rgb, seen.splat + 6, 3));
        worst = fmax(worst, difference(grads.gaussians.means + 3 * i, got.field[SF_FIELD_mean], 3));
        worst = fmax(worst, difference(grads.gaussians.log_scales + 3 * i, got.field[SF_FIELD_log_scale], 3));
        worst = fmax(worst, difference(grads.gaussians.quats + 4 * i, got.field[SF_FIELD_quat], 4));
        worst = fmax(worst,
                     difference(grads.gaussians.logit_opacities + i, got.field[SF_FIELD_logit_opacity], 1));
        worst = fmax(worst, difference(grads.pose, got.camera, 6));
        worst = fmax(worst, difference(grads.focal, got.camera + 6, 2));
        size_t sh = 3 * (size_t)((r->sh_degree + 1) * (r->sh_degree + 1));
        worst = fmax(worst, difference(grads.gaussians.sh + sh * i, got.field[SF_FIELD_sh0], 3));
    }
    test_ref_gaussians_free(&grads.gaussians);
    return worst;
}

/* With a camera that float32 holds exactly: in the origin, its axes the world's by other names. */
static void bounds_stand_on_the_reference(void **state) {
    (void)state;
    static check c;
    static scene s;
    double worst = 0;
    for (c.seed = 0; c.seed < 40; c.seed++) {
        test_ref_scene r = {.count = 0};
        sf_rng_seed(&c.rng, c.seed);
        memset(&s, 0, sizeof s);
        s.kind = PLAIN;
        make_eye(&c, &s);
        for (int k = 0; k < 3; k++) s.eye.t[k] = s.eye.center[k] = 0;
        for (int k = 0; k < 9; k++) s.eye.R[k] = (float)(k % 4 == 1 || k == 6);
        make_gaussians(&c, &s);
        s.args.antialiased = (int)(c.seed % 2), s.args.sh_degree = s.stored_degree;
        to_reference(&s, &r);
        for (size_t i = 0; i < s.count; i++) worst = fmax(worst, against_reference(&c, &s, &r, i));
        test_ref_gaussians_free(&r.gaussians);
        check_free(&c);
    }
    print_message("relative difference %.1e\n", worst);
    assert_true(worst > 0 && worst < 1e-9);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(bounds_stand_on_the_reference),
                                       cmocka_unit_test(project_agrees_with_float64)};
    return cmocka_run_group_tests_name("check project", tests, NULL, NULL);
}
