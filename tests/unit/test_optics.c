/* test_optics.c - COLMAP's camera models against their equations, and pictures of each against the scene. */
#include "testing.h"

#include "io/undistort.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT, MODELS = 11 };

#define PI 3.14159265358979323846

/* Parameters as COLMAP writes them, of lenses that bend much. */
static const double parameters[MODELS][SF_OPTICS_PARAMETERS] = {
    {60, 47, 37},
    {60, 58, 47, 37},
    {60, 47, 37, -0.12},
    {60, 47, 37, -0.14, 0.02},
    {60, 58, 47, 37, -0.12, 0.02, 0.004, -0.003},
    {55, 54, 47, 37, -0.05, 0.01, -0.004, 0.0005},
    {60, 58, 47, 37, 0.1, 0.02, 0.003, -0.002, 0.001, 0.2, 0.04, 0.002},
    {60, 58, 47, 37, 0.9},
    {55, 47, 37, -0.04},
    {55, 47, 37, -0.04, 0.003},
    {55, 54, 47, 37, -0.04, 0.01, 0.002, -0.001, -0.002, 0.0003, 0.01, -0.008},
};

/* The equations, each written out from the model's definition: a ray (x, y, 1) to a pixel. */

static void radial_tangential(const double *k, double x, double y, double d, double out[2]) {
    double r2 = x * x + y * y;
    out[0] = x * d + 2 * k[0] * x * y + k[1] * (r2 + 2 * x * x);
    out[1] = y * d + 2 * k[1] * x * y + k[0] * (r2 + 2 * y * y);
}

static void to_fisheye(double *x, double *y) {
    double r = sqrt(*x * *x + *y * *y), factor = r > 0 ? atan2(r, 1) / r : 1;
    *x *= factor;
    *y *= factor;
}

static void seen_at(int model, double x, double y, double out[2]) {
    const double *p = parameters[model];
    int one = model == 0 || model == 2 || model == 3 || model == 8 || model == 9;
    const double *k = p + (one ? 3 : 4);
    if (model == 5 || model >= 8) to_fisheye(&x, &y);
    double r = sqrt(x * x + y * y), r2 = r * r, r4 = r2 * r2, r6 = r4 * r2, r8 = r4 * r4, f = 1;
    static const double none[2] = {0, 0};
    switch (model) {
    case 0:
    case 1:
        radial_tangential(none, x, y, 1, out);
        break;
    case 2:
    case 8:
        radial_tangential(none, x, y, 1 + k[0] * r2, out);
        break;
    case 3:
    case 9:
        radial_tangential(none, x, y, 1 + k[0] * r2 + k[1] * r4, out);
        break;
    case 4:
        radial_tangential(k + 2, x, y, 1 + k[0] * r2 + k[1] * r4, out);
        break;
    case 5:
        radial_tangential(none, x, y, 1 + k[0] * r2 + k[1] * r4 + k[2] * r6 + k[3] * r8, out);
        break;
    case 6:
        radial_tangential(k + 2, x, y,
                          (1 + k[0] * r2 + k[1] * r4 + k[4] * r6) / (1 + k[5] * r2 + k[6] * r4 + k[7] * r6),
                          out);
        break;
    case 7:
        f = r > 0 ? atan(2 * r * tan(k[0] / 2)) / (r * k[0]) : 2 * tan(k[0] / 2) / k[0];
        radial_tangential(none, x, y, f, out);
        break;
    default:
        radial_tangential(k + 2, x, y, 1 + k[0] * r2 + k[1] * r4 + k[4] * r6 + k[5] * r8, out);
        out[0] += k[6] * r2;
        out[1] += k[7] * r2;
    }
    out[0] = p[0] * out[0] + (one ? p[1] : p[2]);
    out[1] = (one ? p[0] : p[1]) * out[1] + (one ? p[2] : p[3]);
}

/* The ray of a pixel, by Newton's steps on the equation with differences. */
static int ray_of(int model, double u, double v, double ray[2]) {
    sf_optics o = sf_optics_make(sf_lens_model_at((unsigned)model), parameters[model]);
    ray[0] = (u - o.cx) / o.fx;
    ray[1] = (v - o.cy) / o.fy;
    for (int i = 0; i < 60; i++) {
        double at[2], right[2], down[2], h = 1e-6;
        seen_at(model, ray[0], ray[1], at);
        seen_at(model, ray[0] + h, ray[1], right);
        seen_at(model, ray[0], ray[1] + h, down);
        double a = (right[0] - at[0]) / h, b = (down[0] - at[0]) / h, c = (right[1] - at[1]) / h,
               d = (down[1] - at[1]) / h, det = a * d - b * c, e = u - at[0], f = v - at[1];
        ray[0] += (d * e - b * f) / det;
        ray[1] += (a * f - c * e) / det;
    }
    double back[2];
    seen_at(model, ray[0], ray[1], back);
    return hypot(back[0] - u, back[1] - v) < 1e-9;
}

static sf_optics optics_of(int model) {
    const sf_lens_model *m = sf_lens_model_at((unsigned long)model);
    assert_non_null(m);
    assert_ptr_equal(sf_lens_model_named(m->name), m);
    sf_optics o = sf_optics_make(m, parameters[model]);
    assert_string_equal(o.model, m->name);
    assert_true(sf_optics_is_valid(&o));
    assert_int_equal(sf_optics_is_distorted(&o), model > 1);
    return o;
}

static void test_equations(void **state) {
    (void)state;
    for (int model = 0; model < MODELS; model++) {
        sf_optics o = optics_of(model);
        double limit = sf_optics_limit(&o), worst = 0;
        for (int i = 0; i < PIXELS; i++) {
            double u = i % WIDTH, v = i / WIDTH, expected[2], got[2];
            if (!sf_optics_source(&o, limit, u, v, got)) fail_msg("%s: turns back at %g, %g", o.model, u, v);
            seen_at(model, (u - o.cx) / o.fx, (v - o.cy) / o.fy, expected);
            worst = fmax(worst, hypot(got[0] + 0.5 - expected[0], got[1] + 0.5 - expected[1]));
        }
        if (!(worst < 1e-12 * 200)) fail_msg("%s: off by %g px", o.model, worst);
    }
}

static double shade(double x, double y, int channel) {
    return 127 + 60 * sin(3 * x + channel) + 50 * cos(2 * y - x + channel);
}

static sf_picture photograph(sf_context *ctx, int model) {
    sf_picture p = {.width = WIDTH, .height = HEIGHT, .orientation = 1};
    p.rgb = sf_alloc(ctx, PIXELS, 3);
    assert_non_null(p.rgb);
    for (int i = 0; i < PIXELS; i++) {
        double ray[2];
        assert_true(ray_of(model, i % WIDTH + 0.5, i / WIDTH + 0.5, ray));
        for (int c = 0; c < 3; c++) p.rgb[c * PIXELS + i] = (uint8_t)(shade(ray[0], ray[1], c) + 0.5);
    }
    return p;
}

/* A picture by each lens, made with the inverse of its equation, becomes what the pinhole camera sees: where
 * the lens' picture reaches, and nothing is shown anywhere else. */
static void test_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int model = 2; model < MODELS; model++) {
        sf_optics o = optics_of(model);
        sf_picture p = photograph(ctx, model);
        sf_undistorted f = sf_undistort_frame(&o, WIDTH, HEIGHT);
        int wide = model == 5 || model >= 7, kept = 0;
        assert_ok(ctx, sf_undistort(ctx, &o, &p));
        assert_int_equal(p.width, f.width);
        assert_int_equal(p.height, f.height);
        assert_int_equal(f.width > WIDTH && f.height > HEIGHT, wide);
        for (int i = 0; i < p.width * p.height; i++) {
            double x = (i % p.width + 0.5 - f.cx) / o.fx, y = (i / p.width + 0.5 - f.cy) / o.fy, at[2];
            seen_at(model, x, y, at);
            int inside = at[0] >= 0.5 && at[1] >= 0.5 && at[0] <= WIDTH - 0.5 && at[1] <= HEIGHT - 0.5;
            assert_int_equal(p.weight[i], inside ? 255 : 0);
            kept += inside;
            for (int c = 0; c < 3 && inside; c++)
                if (!(fabs(p.rgb[c * p.width * p.height + i] - shade(x, y, c)) <= 2))
                    fail_msg("%s: pixel %d: %d is not %g", o.model, i, p.rgb[c * p.width * p.height + i],
                             shade(x, y, c));
        }
        assert_between(kept, p.width * p.height * 8 / 10, p.width * p.height);
        sf_picture_free(ctx, &p);
    }
    sf_context_destroy(&ctx);
}

/* The angle of a ray is where the equation puts it. */
static void test_angles(void **state) {
    (void)state;
    for (int model = 0; model < MODELS; model++) {
        sf_optics o = optics_of(model);
        memset(o.p, 0, sizeof o.p); /* radial terms alone count */
        memset(o.s, 0, sizeof o.s);
        for (double x = 0.05; x < 0.8; x += 0.05) {
            double source[2];
            assert_true(sf_optics_source(&o, INFINITY, o.cx + x * o.fx, o.cy, source));
            double r = (source[0] + 0.5 - o.cx) / o.fx;
            if (!(fabs(sf_optics_angle(&o, r) - atan(x)) < 1e-12))
                fail_msg("%s: %g: %.17g is not %.17g", o.model, x, sf_optics_angle(&o, r), atan(x));
        }
    }
}

static void test_field_of_a_fisheye(void **state) {
    (void)state;
    double seen, kept;
    const double half = WIDTH / 2.0, f = WIDTH / PI;
    sf_optics o = {.model = "OPENCV_FISHEYE", .projection = SF_EQUIDISTANT, f, f, half, half};
    sf_undistort_field(&o, WIDTH, WIDTH, &seen, &kept); /* 180 degrees across */
    assert_true(fabs(seen - 180) < 1e-9);
    assert_true(fabs(kept - 120) < 1);
    sf_undistorted frame = sf_undistort_frame(&o, WIDTH, WIDTH);
    assert_int_equal(frame.width, WIDTH + 2 * lround(f * sqrt(3) - half));
    assert_int_equal(frame.width, frame.height);
    assert_true(frame.cx == frame.width / 2.0);
    o.fx = o.fy = f / 2; /* all around: smaller than the picture */
    sf_undistort_field(&o, WIDTH, WIDTH, &seen, &kept);
    assert_true(fabs(seen - 360) < 1e-9);
    assert_true(fabs(kept - 120) < 1);
    assert_true(sf_undistort_frame(&o, WIDTH, WIDTH).width < WIDTH);
    o.fx = o.fy = 2 * f; /* 90 degrees: all of them */
    sf_undistort_field(&o, WIDTH, WIDTH, &seen, &kept);
    assert_true(fabs(seen - 90) < 1e-9 && fabs(kept - 90) < 1);
    o = (sf_optics){.model = "PINHOLE", .fx = half, .fy = half, .cx = half, .cy = half};
    sf_undistort_field(&o, WIDTH, WIDTH, &seen, &kept);
    assert_true(fabs(seen - 90) < 1e-9 && fabs(kept - 90) < 1e-9);
    o.projection = SF_EQUIDISTANT; /* what nothing can show is left as it is */
    o.fx = 1e300;
    assert_int_equal(sf_undistort_frame(&o, WIDTH, WIDTH).width, WIDTH);
    o.fx = 40000; /* far off the axis */
    o.cx = 30000;
    assert_int_equal(sf_undistort_frame(&o, 4, 3).width, 4);
    o.cx = -1e300;
    assert_int_equal(sf_undistort_frame(&o, 4, 3).width, 4);
    o.fx = NAN;
    assert_int_equal(sf_undistort_frame(&o, WIDTH, WIDTH).width, WIDTH);
    o.fx = o.fy = 40000; /* larger, it would be more than a picture may be */
    o.cx = o.cy = 30000;
    assert_int_equal(sf_undistort_frame(&o, 60000, 60000).width, 60000);
}

/* Beyond the angle at which the picture turns back, the same pixels would be seen again. */
static void test_turning_back(void **state) {
    (void)state;
    static const struct {
        sf_optics o;
        double limit; /* of the angle for a fisheye, of its tangent otherwise */
    } cases[] = {
        {{.projection = SF_EQUIDISTANT, .fx = 1, .fy = 1, .k = {-1.0 / 3}}, 1},
        {{.projection = SF_EQUIDISTANT, .fx = 1, .fy = 1, .k = {0, -0.2}}, 1},
        {{.projection = SF_EQUIDISTANT, .fx = 1, .fy = 1, .k = {0.1, 0.1}}, INFINITY},
        {{.projection = SF_PERSPECTIVE, .fx = 1, .fy = 1, .k = {0, 0, -1.0 / 7 / 64}}, 2},
        {{.projection = SF_PERSPECTIVE, .fx = 1, .fy = 1, .q = {1}}, 1},     /* r / (1 + r^2) */
        {{.projection = SF_PERSPECTIVE, .fx = 1, .fy = 1, .q = {-0.25}}, 2}, /* r / (1 - r^2 / 4): a pole */
        {{.projection = SF_FIELD_OF_VIEW, .fx = 1, .fy = 1, .omega = 1}, INFINITY},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const sf_optics *o = &cases[i].o;
        double limit = sqrt(sf_optics_limit(o)), expected = cases[i].limit;
        if (o->projection == SF_EQUIDISTANT && isfinite(expected)) expected = tan(expected);
        if (isinf(expected) ? !isinf(limit) : !(fabs(limit - expected) < 1e-9))
            fail_msg("case %zu: %.17g is not %.17g", i, limit, expected);
        double out[2];
        if (isfinite(expected)) assert_false(sf_optics_source(o, limit * limit, 1.01 * limit, 0, out));
    }
}

static void test_validity(void **state) {
    (void)state;
    static const char letters[] = "xyuv1234567abstw";
    for (const char *c = letters; *c; c++) {
        sf_optics o = {.fx = 1, .fy = 1};
        assert_true(sf_optics_is_valid(&o));
        assert_int_equal(sf_optics_is_distorted(&o), 0);
        *sf_optics_value(&o, *c) = NAN;
        assert_false(sf_optics_is_valid(&o));
        *sf_optics_value(&o, *c) = 0.5;
        assert_true(sf_optics_is_valid(&o));
    }
    sf_optics o = {.fx = 1, .fy = 1, .omega = 4};
    sf_lens lens;
    assert_false(sf_optics_is_valid(&o));
    o.projection = SF_EQUIDISTANT;
    assert_false(sf_optics_to_lens(&o, &lens));
    o = (sf_optics){.fx = 1, .fy = 1, .k = {0, 0, -1.0 / 7, 0}}; /* r d(r) turns back at r = 1 */
    assert_true(sf_optics_to_lens(&o, &lens) && lens.k3 == o.k[2] && sf_lens_is_distorted(&lens));
    assert_true(sf_optics_of(&lens).k[2] == o.k[2] && fabs(sf_optics_limit(&o) - 1) < 1e-9);
    o.k[3] = 0.1;
    assert_false(sf_optics_to_lens(&o, &lens));
    assert_null(sf_lens_model_at(18));
    assert_null(sf_lens_model_named("PINWHEEL"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_equations),    cmocka_unit_test(test_pictures),
        cmocka_unit_test(test_angles),       cmocka_unit_test(test_field_of_a_fisheye),
        cmocka_unit_test(test_turning_back), cmocka_unit_test(test_validity),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
