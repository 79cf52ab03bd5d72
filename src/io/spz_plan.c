/* spz_plan.c - what a .spz can do without: bits of the means and of the SH, and the order of the Gaussians.
 *
 * The constants are what fits of the fox's training views lost in renders of views that they did not see:
 * README.md has the figures.
 */
#include "../base/statistics.h"
#include "../scene/curve.h"
#include "quantise.h"
#include "spz.h"

/* Steps of the means for the middle axis of the median Gaussian, at least. */
#define MEAN_STEPS 12.0

/* Bits of SH above band 1 (which has one more) of the Gaussian of median weight, and by how much they rise
 * where the weight doubles. An error of the SH counts with the weight; half a bit would make all errors count
 * alike, but what a Gaussian's weight is when others are before it is not known. */
#define MEDIAN_BITS   5.7
#define DOUBLING_BITS 0.25

enum { BITS_MOST = 8 };

/* What is measured of the Gaussians, [count] each. */
typedef struct measures {
    float *log_weights; /* of opacity^2 times the area of the two longest axes */
    float *log_middles; /* middle axes */
    float *sorted;
    double most; /* greatest coordinate of a mean */
} measures;

static sf_status measure(const sf_model *model, measures *m) {
    for (size_t i = 0; i < sf_model_count(model); i++) {
        float mean[3], s[3], logit;
        const sf_gaussians f = {.means = mean, .log_scales = s, .logit_opacities = &logit};
        sf_status status = sf_model_get(model, i, 1, &f);
        if (status) return status;
        float shortest = fminf(s[0], fminf(s[1], s[2])), longest = fmaxf(s[0], fmaxf(s[1], s[2]));
        m->log_middles[i] = s[0] + s[1] + s[2] - shortest - longest;
        m->log_weights[i] = m->log_middles[i] + longest + 2 * (float)log(sf_sigmoid((double)logit));
        for (int k = 0; k < 3; k++) m->most = fmax(m->most, fabs((double)mean[k]));
    }
    return SF_OK;
}

/* As many fractional bits as the Gaussians' sizes call for, and no more than leave room for all means. */
static void choose_fraction(const sf_model *model, measures *m, const char *path, sf_spz_plan *plan) {
    size_t n = sf_model_count(model);
    for (size_t i = 0; i < n; i++) m->sorted[i] = m->log_middles[i];
    double wanted = ceil(log2(MEAN_STEPS) - (double)sf_medianf(m->sorted, n) / log(2));
    int fraction = (int)fmax(0, fmin(wanted, SF_SPZ_FRACTION_MOST)), most = fraction;
    while (fraction && ldexp(m->most, fraction) > SF_SPZ_MEAN_MOST) fraction--;
    if (fraction < most)
        sf_log(model->ctx, SF_LOG_WARNING, "%s: coordinates of up to %g leave steps of %g to the means", path,
               m->most, ldexp(1, -fraction));
    plan->fraction = fraction;
}

static sf_status choose_classes(const sf_model *model, measures *m, sf_spz_plan *plan) {
    size_t n = sf_model_count(model);
    plan->classes = sf_alloc(model->ctx, n + 1, 1);
    if (!plan->classes) return SF_ERR_MEMORY;
    for (size_t i = 0; i < n; i++) m->sorted[i] = m->log_weights[i];
    float median = sf_medianf(m->sorted, n);
    for (size_t i = 0; i < n; i++) {
        double doublings = (double)(m->log_weights[i] - median) / log(2);
        plan->classes[i] = (uint8_t)fmax(1, fmin(round(MEDIAN_BITS + DOUBLING_BITS * doublings), BITS_MOST));
    }
    return SF_OK;
}

sf_status sf_spz_make_plan(const sf_model *model, const int sh_bits[2], const char *path, sf_spz_plan *plan) {
    size_t n = sf_model_count(model);
    float *block = sf_alloc(model->ctx, n + 1, 3 * sizeof *block);
    if (!block) return SF_ERR_MEMORY;
    measures m = {.log_weights = block, .log_middles = block + n, .sorted = block + 2 * n};
    *plan = (sf_spz_plan){.sh_bits = {sh_bits[0], sh_bits[1]}};
    sf_status status = measure(model, &m);
    if (!status) choose_fraction(model, &m, path, plan);
    if (!status && !sh_bits[0]) status = choose_classes(model, &m, plan);
    const sf_gaussians means = {.means = block};
    if (!status) status = sf_model_get(model, 0, n, &means);
    if (!status) status = sf_curve_order(model->ctx, block, n, plan->classes, &plan->order);
    sf_free(model->ctx, block);
    return status;
}

void sf_spz_free_plan(sf_context *ctx, sf_spz_plan *plan) {
    sf_free(ctx, plan->classes);
    sf_free(ctx, plan->order);
}

void sf_spz_sh_bits(const sf_spz_plan *plan, size_t i, int bits[2]) {
    int above = plan->classes ? plan->classes[i] : plan->sh_bits[1];
    bits[1] = above;
    bits[0] = !plan->classes ? plan->sh_bits[0] : above < BITS_MOST ? above + 1 : BITS_MOST;
}
