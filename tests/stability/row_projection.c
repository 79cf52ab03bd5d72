/* row_projection.c - rows 2 and 4: what the projection does far off the axis, and quaternions of any size. */
#include <stdio.h>
#include <stdlib.h>

#include "lab.h"
#include "render/workspace.h"
#include "textbook.h"

/* ---- row 2: the Jacobian near z = 0 and at wide angles --------------------------------------------------
 */

enum { WIDTH = 64, HEIGHT = 48 };
static const double FOCAL = 55, SIZE = 0.05, DEGREE = 3.14159265358979323846 / 180;

static double clamp_x(void) { return 1.3 * WIDTH / (2 * FOCAL); }

/* The scene's one Gaussian on the screen, as the library projects it. */
static sf_splat project(const stab_lab *lab, const test_ref_scene *scene, int *state) {
    sf_workspace ws;
    sf_model *model = test_model_of(lab->ctx, scene);
    sf_workspace_init(&ws, lab->ctx);
    assert_ok(lab->ctx, sf_workspace_look(&ws, &scene->camera, (float)scene->near_plane));
    assert_ok(lab->ctx, sf_stage_project(&ws, model, 0, 0));
    sf_splat splat = ws.splats[0];
    *state = ws.state[0];
    sf_workspace_free(&ws);
    sf_model_destroy(&model);
    return splat;
}

static test_ref_scene off_axis(double tangent, double z, double size) {
    test_ref_scene scene = stab_scene(1, WIDTH, HEIGHT, FOCAL);
    scene.gaussians.means[0] = (float)(tangent * z);
    scene.gaussians.means[2] = (float)z;
    for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[k] = (float)log(size);
    return scene;
}

/* The diagonal of what the Gaussian covers, in those of the picture; 0 where it covers none of it. */
static double extent(const stab_lab *lab, double tangent, double z) {
    test_ref_scene scene = off_axis(tangent, z, SIZE);
    int state;
    sf_splat s = project(lab, &scene, &state);
    test_ref_gaussians_free(&scene.gaussians);
    return state == SF_SEEN ? 2 * hypot((double)s.half_width, (double)s.half_height) / hypot(WIDTH, HEIGHT)
                            : 0;
}

/* The same by J at x/z itself; where what it covers reaches the picture. */
static double textbook_extent(double tangent, double z) {
    double across = FOCAL * SIZE / z, reach = sqrt(2 * log(255 * 0.9));
    double half = reach * sqrt(across * across * (1 + tangent * tangent) + 0.3);
    if (FOCAL * tangent - half > 0.5 * WIDTH) return 0;
    return 2 * hypot(half, reach * sqrt(across * across + 0.3)) / hypot(WIDTH, HEIGHT);
}

static void sweep_extents(stab_run *run, const stab_lab *lab) {
    static const double depths[] = {1, 0.201};
    int by = (int)stab_count(run, 1, 5, 20);
    double most = 0, textbook = 0;
    stab_chart_begin(run, "What a Gaussian of 0.05 covers, over the angle to the axis",
                     (stab_axis){"angle (degrees)", 0}, (stab_axis){"diagonals of the picture (1)", 1});
    for (size_t d = 0; d < 2; d++)
        for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
            stab_series_begin(run, (stab_line)line, "%s, z = %g",
                              line == STAB_OURS ? "ours" : "textbook, no clamp", depths[d]);
            for (int angle = 0; angle <= 89; angle += angle < 89 && angle + by > 89 ? 89 - angle : by) {
                double tangent = tan(angle * DEGREE);
                double e =
                    line == STAB_OURS ? extent(lab, tangent, depths[d]) : textbook_extent(tangent, depths[d]);
                stab_point(run, angle, e);
                if (line == STAB_OURS) most = stab_worse(most, e);
                if (line == STAB_TEXTBOOK) textbook = fmax(textbook, e);
            }
        }
    stab_bound_line(run, 3, "bound");
    stab_at_most(run, most, 3, "diagonals",
                 "extent on the screen, 0 to 89 degrees, z down to the near plane");
    stab_textbook(run, textbook);
}

static double length(const double *values, size_t n) {
    double squares = 0;
    for (size_t k = 0; k < n; k++) squares += values[k] * values[k];
    return sqrt(squares);
}

/* A gradient of the library's against central differences in float64 with steps h, relative to the largest.
 */
static double difference_error(const test_ref_scene *scene, double *values, const float *gradient, size_t n,
                               double h) {
    double most = 0, worst = 0;
    for (size_t k = 0; k < n; k++) {
        double expected = stab_difference(scene, &values[k], h);
        most = fmax(most, fabs(expected));
        worst = stab_worse(worst, fabs(expected - (double)gradient[k]));
    }
    return worst / most;
}

static void compare_differences(stab_run *run, const stab_lab *lab) {
    static const double sides[] = {0.5, 0.7, 0.9, 0.97, 0.99, 1.01, 1.03, 1.1, 1.3, 1.5};
    double most = 0;
    stab_chart_begin(run, "Gradient by the mean against central differences, across the clamp",
                     (stab_axis){"x/z over where it is clamped (1)", 0},
                     (stab_axis){"error, relative to the largest component (1)", 1});
    stab_series_begin(run, STAB_OURS, "ours, a Gaussian of 1 at z = 1");
    for (size_t k = 0; k < sizeof sides / sizeof *sides; k += stab_count(run, 1, 1, 3)) {
        test_ref_scene scene = off_axis(sides[k] * clamp_x(), 1, 1);
        test_outcome o = test_outcome_of(lab->ctx, lab->renderer, &scene);
        double error = difference_error(&scene, scene.gaussians.means, o.gradient.means, 3, 1e-4);
        test_outcome_free(&o);
        stab_point(run, sides[k], error);
        most = stab_worse(most, error);
        test_ref_gaussians_free(&scene.gaussians);
    }
    stab_bound_line(run, 1e-3, "bound");
    stab_at_most(run, most, 1e-3, "", "central differences on both sides of the clamp, relative error");
}

static void wide_angles(stab_run *run) {
    stab_lab lab = stab_lab_open(NULL);
    sweep_extents(run, &lab);
    compare_differences(run, &lab);
    stab_lab_close(&lab);
}

const stab_row stab_row_2 = {
    .id = "2",
    .failure = "The projection's Jacobian blows up near z = 0 and at wide angles",
    .cure = "It is taken at x/z clamped to 1.3 of the picture's edge, with the exact derivative of the "
            "clamp; what is "
            "nearer than the near plane is culled.",
    .quick = 1,
    .run = wide_angles,
};

/* ---- row 4: quaternions ---------------------------------------------------------------------------------
 */

static test_ref_scene turned(double norm) {
    static const double quat[4] = {0.5, -0.75, 0.25, 0.375};
    test_ref_scene scene = stab_scene(1, 32, 32, 40);
    for (size_t k = 0; k < 4; k++) scene.gaussians.quats[k] = (float)(quat[k] * norm);
    for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[k] = (float)(-1.5 - 0.6 * (double)k);
    scene.gaussians.means[0] = 0.0625f;
    return scene;
}

/* The textbook's picture against float64; what cannot be drawn is infinite. */
static double textbook_error(const test_ref_scene *scene, const test_ref_frame *truth) {
    test_ref_scene changed = *scene;
    test_ref_frame frame;
    double unit[4];
    stab_textbook_normalise(scene->gaussians.quats, unit);
    changed.gaussians.quats = unit;
    test_ref_render(&changed, &frame);
    size_t values = 3 * (size_t)scene->camera.width * (size_t)scene->camera.height;
    double error = test_worst_of_doubles(frame.rgb, truth->rgb, values);
    test_ref_frame_free(&frame);
    return error;
}

typedef struct norms {
    double picture, textbook, gradient, difference;
    size_t culled, counted;
} norms;

static void try_norm(const stab_lab *lab, double norm, norms *n) {
    test_ref_scene scene = turned(norm);
    stab_truth truth = stab_truth_of(&scene);
    stab_errors e = stab_compare(lab, &truth);
    int state;
    project(lab, &scene, &state);
    n->culled += !truth.frame.visible;
    n->counted += state == SF_NOT_FINITE;
    n->picture = fmax(n->picture, e.rgb);
    n->gradient = fmax(n->gradient, e.worst_gradient);
    double textbook = truth.frame.visible ? textbook_error(&scene, &truth.frame) : NAN;
    if (truth.frame.visible) {
        n->textbook = fmax(n->textbook, textbook);
        test_outcome o = test_outcome_of(lab->ctx, lab->renderer, &scene);
        double *q = scene.gaussians.quats, h = 1e-6 * length(q, 4);
        n->difference = stab_worse(n->difference, difference_error(&scene, q, o.gradient.quats, 4, h));
        test_outcome_free(&o);
    }
    stab_truth_free(&truth);
    test_ref_gaussians_free(&scene.gaussians);
}

static void quaternions(stab_run *run) {
    static const double exponents[] = {-300, -30, -25, -20, -15, -13, -11, -8, -4, 0, 4, 8, 15, 20, 25, 30};
    stab_lab lab = stab_lab_open(NULL);
    norms all = {0};
    enum { NORMS = sizeof exponents / sizeof *exponents };
    double picture[NORMS], textbook[NORMS];
    size_t by = stab_count(run, 1, 1, 4);
    for (size_t k = 0; k < NORMS; k += by) {
        norms one = {0};
        try_norm(&lab, pow(10, exponents[k]), &one); /* the first is 0 as a float */
        picture[k] = one.picture, textbook[k] = one.culled ? NAN : one.textbook;
        all.picture = fmax(all.picture, one.picture), all.gradient = fmax(all.gradient, one.gradient);
        all.textbook = fmax(all.textbook, one.textbook),
        all.difference = stab_worse(all.difference, one.difference);
        all.culled += one.culled, all.counted += one.counted;
    }
    stab_chart_begin(run, "Picture of a Gaussian over the norm of its quaternion", (stab_axis){"norm (1)", 1},
                     (stab_axis){"error against float64 (colour)", 1});
    for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
        stab_series_begin(run, (stab_line)line, line == STAB_OURS ? "ours" : "textbook: squares in float32");
        for (size_t k = 1; k < NORMS; k += by)
            if (line == STAB_OURS || !isnan(textbook[k]))
                stab_point(run, pow(10, exponents[k]),
                           fmax(line == STAB_OURS ? picture[k] : textbook[k], 1e-9));
    }
    stab_at_most(run, all.picture, 1e-5, "colour", "error of the picture, |q| 0 to 1e30");
    stab_textbook(run, all.textbook);
    stab_at_most(run, all.gradient, 1e-5, "", "error of a gradient, relative, |q| 0 to 1e30");
    stab_at_most(run, all.difference, 1e-3, "",
                 "central differences by q, relative error, |q| 1e-11 to 1e30");
    stab_at_most(run, fabs((double)all.culled - (double)all.counted), 0, "",
                 "|q| < 1e-12: culled, not counted");
    stab_lab_close(&lab);
}

const stab_row stab_row_4 = {
    .id = "4",
    .failure = "Quaternions that are zero, denormal or huge",
    .cure = "They are normalised in float64 and the normalisation is differentiated; one shorter than 1e-12 "
            "has no "
            "direction, and its Gaussian is left out and counted.",
    .quick = 1,
    .run = quaternions,
};
