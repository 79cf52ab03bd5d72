/* loss_fixture.c - see the header. */
#include "loss_fixture.h"

#include <math.h>
#include <stdlib.h>

#include "reference/random.h"

/* float32 against float64, as for the golden cases: values absolute, the gradient relative to its largest. */
const double loss_VALUE_BOUND = 1e-6, loss_GRADIENT_BOUND = 2e-4;

float *loss_floats(size_t n) {
    float *values = calloc(n, sizeof *values);
    assert_non_null(values);
    return values;
}

static float weight_at(enum weighting how, int x, int y, int width, sf_rng *rng) {
    double edge = x - 0.4 * width + 0.3 * y; /* a slanting line */
    if (how == WEIGHT_FRACTION) return (float)sf_rng_uniform(rng);
    if (how == WEIGHT_REGION) return (float)fmin(fmax(0.5 * edge, 0), 1);
    return 1;
}

pair loss_pair_create(uint64_t seed, int width, int height, enum weighting how) {
    pair p = {.width = width, .height = height, .pixels = (size_t)width * (size_t)height};
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    p.rgb = loss_floats(3 * p.pixels);
    p.target = loss_floats(3 * p.pixels);
    if (how != WEIGHT_NONE) p.weight = loss_floats(p.pixels);
    for (size_t i = 0; i < 3 * p.pixels; i++) {
        size_t x = i / 3 % (size_t)width, y = i / 3 / (size_t)width;
        double smooth = 0.5 + 0.3 * sin(0.3 * (double)x + (double)(i % 3)) * cos(0.2 * (double)y);
        p.target[i] = (float)(smooth + 0.1 * sf_rng_normal(&rng));
        p.rgb[i] = (float)((double)p.target[i] + 0.1 * sf_rng_normal(&rng));
    }
    for (size_t i = 0; p.weight && i < p.pixels; i++)
        p.weight[i] = weight_at(how, (int)(i % (size_t)width), (int)(i / (size_t)width), width, &rng);
    if (p.weight) p.weight[p.pixels - 1] = 0.75f; /* never all 0 */
    return p;
}

void loss_pair_free(pair *p) {
    free(p->rgb);
    free(p->target);
    free(p->weight);
}

bench loss_bench_create(int threads) {
    bench b = {.ctx = test_context_threads(threads)};
    assert_ok(b.ctx, sf_renderer_create(b.ctx, &b.renderer));
    return b;
}

void loss_bench_free(bench *b) {
    sf_renderer_destroy(&b->renderer);
    sf_context_destroy(&b->ctx);
}

double *loss_to_double(const float *from, size_t n) {
    if (!from) return NULL;
    double *to = test_ref_numbers(n);
    for (size_t i = 0; i < n; i++) to[i] = from[i];
    return to;
}
