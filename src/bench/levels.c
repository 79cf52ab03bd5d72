/* levels.c - the levels of this machine: kernels, roofs and variants of blending, by name. */
#include "levels.h"

#include <string.h>

#include <splatfit/context.h>

#define VARIANT(level, name)                                                                                 \
    void sf_blend_##level##_##name(const sf_blend_args *args);                                               \
    void sf_blend_bwd_##level##_##name(const sf_blend_args *args);
#define VARIANTS(level)                                                                                      \
    VARIANT(level, exp2)                                                                                     \
    VARIANT(level, exp3)                                                                                     \
    VARIANT(level, exp4)                                                                                     \
    VARIANT(level, exp5)                                                                                     \
    VARIANT(level, exp6)                                                                                     \
    VARIANT(level, cull)

/* As arch/levels.mk builds them for the family of this machine. */
#if defined(__x86_64__) || defined(__i386__)
#define LEVELS(X) X(sse4) X(avx2) X(avx512)
#elif defined(__arm__) || defined(__aarch64__)
#define LEVELS(X) X(neon)
#else
#define LEVELS(X)
#endif

LEVELS(VARIANTS)

typedef struct built {
    const char *name;
    void (*roof)(sf_roof *roof);
    struct {
        bench_blend_fn blend, blend_bwd;
    } variant[BENCH_VARIANTS];
} built;

#define ENTRY(level, name)                                                                                   \
    { sf_blend_##level##_##name, sf_blend_bwd_##level##_##name }
#define BUILT(level)                                                                                         \
    {#level,                                                                                                 \
     sf_roof_##level,                                                                                        \
     {[BENCH_EXP2] = ENTRY(level, exp2),                                                                     \
      [BENCH_EXP3] = ENTRY(level, exp3),                                                                     \
      [BENCH_EXP4] = ENTRY(level, exp4),                                                                     \
      [BENCH_EXP5] = ENTRY(level, exp5),                                                                     \
      [BENCH_EXP6] = ENTRY(level, exp6),                                                                     \
      [BENCH_CULL] = ENTRY(level, cull)}},

static const built all_built[] = {LEVELS(BUILT){0}};

#if defined(__x86_64__) || defined(__i386__)
#define ALONE(x) __asm__ volatile("" : "+x"(x))
#elif defined(__aarch64__)
#define ALONE(x) __asm__ volatile("" : "+w"(x))
#elif defined(__arm__)
#define ALONE(x) __asm__ volatile("" : "+t"(x))
#else
#define ALONE(x) __asm__ volatile("" : "+m"(x))
#endif

/* One float at a time, however well the compiler could gather them. */
#define STEP(x)                                                                                              \
    x = x * factor + rest;                                                                                   \
    ALONE(x);

static double multiply_add(size_t rounds) {
    volatile float factor_source = 0.999f, rest_source = 1e-3f; /* unknown to the compiler */
    float factor = factor_source, rest = rest_source;
    float a = 0, b = 1, c = 2, d = 3, e = 4, f = 5, g = 6, h = 7, i = 8, j = 9;
    for (size_t round = 0; round < rounds; round++) {
        STEP(a) STEP(b) STEP(c) STEP(d) STEP(e) STEP(f) STEP(g) STEP(h) STEP(i) STEP(j)
    }
    volatile float sink = a + b + c + d + e + f + g + h + i + j;
    (void)sink;
    return 2.0 * 10.0 * (double)rounds;
}

static float read_all(const float *array, size_t n) {
    float sum[8] = {0};
    for (size_t i = 0; i < n; i += 8)
        for (size_t k = 0; k < 8; k++) sum[k] += array[i + k];
    return sum[0] + sum[1] + sum[2] + sum[3] + sum[4] + sum[5] + sum[6] + sum[7];
}

static void write_all(float *array, size_t n, float value) {
    for (size_t i = 0; i < n; i++) array[i] = value;
}

static void update_all(float *array, size_t n, float value) {
    for (size_t i = 0; i < n; i++) array[i] += value;
}

static const sf_roof scalar_roof = {.lanes = 1,
                                    .block_columns = 1,
                                    .block_rows = 1,
                                    .multiply_add = multiply_add,
                                    .read = read_all,
                                    .write = write_all,
                                    .update = update_all};

static void fill(bench_level *level, const char *name, unsigned mask) {
    *level = (bench_level){.name = name, .roof = scalar_roof};
    sf_kernels_init(&level->kernels, mask);
    for (const built *b = all_built; b->name; b++) {
        if (strcmp(b->name, name)) continue;
        b->roof(&level->roof);
        for (int v = 0; v < BENCH_VARIANTS; v++) {
            level->variant[v].blend = b->variant[v].blend;
            level->variant[v].blend_bwd = b->variant[v].blend_bwd;
        }
    }
}

int bench_levels_find(const char *isa, bench_level *levels) {
    sf_isa_info info;
    int n = 0;
    for (size_t i = 0; n < BENCH_LEVELS_MOST && !sf_isa_describe(i, &info); i++) {
        unsigned mask;
        int wanted = !isa || !strcmp(isa, info.name) || !strcmp(info.name, "scalar");
        if (wanted && info.usable && !sf_cpu_choose(info.name, &mask)) fill(&levels[n++], info.name, mask);
    }
    return n;
}
