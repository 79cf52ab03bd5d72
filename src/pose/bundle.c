/* bundle.c - see bundle.h: one observation. bundle_adjust.c adjusts. */
#include "bundle.h"

#include <math.h>
#include <string.h>

int sf_bundle_pixel(const sf_bundle_view *view, const double p[3], double pixel[2]) {
    return p[2] > SF_BUNDLE_NEAREST && sf_lens_project(&view->lens, p, pixel, NULL, NULL);
}

double sf_bundle_distance(const sf_bundle_view *view, const double at[3], double u, double v) {
    double p[3], pixel[2];
    sf_rigid_apply(&view->pose, at, p);
    if (!sf_bundle_pixel(view, p, pixel)) return INFINITY;
    double x = pixel[0] - u, y = pixel[1] - v;
    return sqrt(x * x + y * y);
}

void sf_bundle_derive(const sf_bundle_view *view, const double p[3], double J[2 * SF_TWIST], double d[6]) {
    double pixel[2], by_p[6] = {0};
    sf_lens_project(&view->lens, p, pixel, by_p, NULL);
    sf_twist_derivative(by_p, p, J);
    if (d) memcpy(d, by_p, sizeof by_p);
}
