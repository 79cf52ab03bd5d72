/* row_extent.c - row 25: what a box at three standard deviations cuts off. */
#include <stdlib.h>

#include "lab.h"

enum { SIDE = 64 };
static const double SIZE = 7.3; /* px, the standard deviation */

/* One round Gaussian off the middle by `shift` px. */
static test_ref_scene round_one(double opacity, double shift) {
    test_ref_scene scene = stab_scene(1, SIDE, SIDE, 100);
    scene.gaussians.means[0] = (float)(shift / 100);
    for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[k] = (float)log(sqrt(SIZE * SIZE - 0.3) / 100);
    stab_set_opacity(&scene, 0, opacity);
    return scene;
}

/* o g of each pixel of the row through the middle, without any end. */
static double endless(double opacity, double shift, int x) {
    double d0 = x + 0.5 - (0.5 * SIDE + shift), d1 = 0.5;
    return opacity * exp(-(d0 * d0 + d1 * d1) / (2 * SIZE * SIZE));
}

/* The same cut off at three standard deviations, as the textbook has it. */
static double boxed(double opacity, double shift, int x) {
    double d0 = x + 0.5 - (0.5 * SIDE + shift);
    double og = endless(opacity, shift, x);
    return fabs(d0) > 3 * SIZE || og < 1.0 / 255 ? 0 : og;
}

/* The library's opacities of that row. */
static void draw_row(const stab_lab *lab, double opacity, double shift, double row[SIDE]) {
    test_ref_scene scene = round_one(opacity, shift);
    test_outcome o = test_outcome_of(lab->ctx, lab->renderer, &scene);
    for (int x = 0; x < SIDE; x++) row[x] = 1 - (double)o.transmittance[SIDE / 2 * SIDE + x];
    test_outcome_free(&o);
    test_ref_gaussians_free(&scene.gaussians);
}

typedef struct cut {
    double ours, textbook; /* the largest opacity that is cut off */
    double ours_difference,
        textbook_difference; /* error of central differences by the mean at the box's edge */
} cut;

/* Where 1/255 is not reached there: at pixels that the edge of the box passes as the mean moves from -h to h;
 * relative to the largest slope. */
static void compare_differences(const stab_lab *lab, double opacity, cut *c) {
    const double h = 0.25, steepest = opacity * exp(-0.5) / SIZE;
    double before[SIDE], after[SIDE];
    double edge = floor(0.5 * SIDE + 3 * SIZE) + 0.5 - 0.5 * SIDE,
           shift = edge - 3 * SIZE; /* a centre on the edge */
    draw_row(lab, opacity, shift - h, before);
    draw_row(lab, opacity, shift + h, after);
    for (int x = 0; x < SIDE; x++) {
        double d0 = x + 0.5 - (0.5 * SIDE + shift), expected = 0;
        if (fabs(fabs(d0) - 3 * SIZE) > h) continue;
        expected = (endless(opacity, shift + h, x) - endless(opacity, shift - h, x)) / (2 * h);
        double got = (after[x] - before[x]) / (2 * h);
        double textbook = (boxed(opacity, shift + h, x) - boxed(opacity, shift - h, x)) / (2 * h);
        c->ours_difference = stab_worse(c->ours_difference, fabs(got - expected) / steepest);
        c->textbook_difference = fmax(c->textbook_difference, fabs(textbook - expected) / steepest);
    }
}

static cut try_opacity(const stab_lab *lab, double opacity) {
    cut c = {0};
    double row[SIDE];
    draw_row(lab, opacity, 0.2, row);
    for (int x = 0; x < SIDE; x++) {
        double og = endless(opacity, 0.2, x);
        if (!(row[x] > 0)) c.ours = fmax(c.ours, og);
        if (boxed(opacity, 0.2, x) == 0) c.textbook = fmax(c.textbook, og);
    }
    if (opacity > 0.45) compare_differences(lab, opacity, &c);
    return c;
}

static void extent(stab_run *run) {
    static const double opacities[] = {0.05, 0.1, 0.2, 0.3, 0.353, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98};
    enum { COUNT = sizeof opacities / sizeof *opacities };
    cut cuts[COUNT], most = {0};
    stab_lab lab = stab_lab_open(NULL);
    size_t by = stab_count(run, 1, 1, 4);
    for (size_t k = 0; k < COUNT; k += by) {
        cuts[k] = try_opacity(&lab, opacities[k]);
        most.ours = fmax(most.ours, cuts[k].ours), most.textbook = fmax(most.textbook, cuts[k].textbook);
        most.ours_difference = stab_worse(most.ours_difference, cuts[k].ours_difference);
        most.textbook_difference = fmax(most.textbook_difference, cuts[k].textbook_difference);
    }
    stab_chart_begin(run, "The largest opacity of a pixel that is cut off",
                     (stab_axis){"opacity of the Gaussian (1)", 0},
                     (stab_axis){"opacity cut off (1/255)", 0});
    for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
        stab_series_begin(run, (stab_line)line, line == STAB_OURS ? "ours" : "textbook: a box at 3 sigma");
        for (size_t k = 0; k < COUNT; k += by)
            stab_point(run, opacities[k], 255 * (line == STAB_OURS ? cuts[k].ours : cuts[k].textbook));
    }
    stab_bound_line(run, 1, "1/255, under which nothing is drawn");
    stab_at_most(run, 255 * most.ours, 1.0001, "1/255", "largest opacity cut off, opacities of 0.05 to 0.98");
    stab_textbook(run, 255 * most.textbook);
    stab_at_most(run, most.ours_difference, 1e-3, "", "central differences across 3 sigma, relative error");
    stab_textbook(run, most.textbook_difference);
    stab_lab_close(&lab);
}

const stab_row stab_row_25 = {
    .id = "25",
    .failure = "A box at 3 sigma cuts visible edges where the opacity is above 0.353",
    .cure = "The extent is exact: as far as o g reaches 1/255 (M.1).",
    .quick = 1,
    .run = extent,
};
