/* levels.h - the levels of this machine, and what each could do at best. */
#ifndef BENCH_LEVELS_H
#define BENCH_LEVELS_H

#include "../../arch/vector/roof.h"
#include "../kernels/kernels.h"

enum { BENCH_LEVELS_MOST = 5 };

/* Variants of blending beside the kernels of the library. */
enum { BENCH_EXP2, BENCH_EXP3, BENCH_EXP4, BENCH_EXP5, BENCH_EXP6, BENCH_CULL, BENCH_VARIANTS };

typedef void (*bench_blend_fn)(const sf_blend_args *args);

typedef struct bench_level {
    const char *name;
    sf_kernels kernels;
    sf_roof roof;
    double gflops[2]; /* one thread, all threads */
    struct {
        bench_blend_fn blend, blend_bwd; /* NULL: not built at this level */
    } variant[BENCH_VARIANTS];
} bench_level;

/* GB/s of float arrays far larger than the caches; [0] one thread, [1] all. */
typedef struct bench_bandwidth {
    double bytes;             /* of the arrays */
    double read[2], write[2]; /* bytes that the program asks for: a write also fetches the line */
    double update[2];         /* read and written in place; both count */
} bench_bandwidth;

/* The usable levels, lowest first; of `isa` (NULL: all) and scalar. Returns how many. */
int bench_levels_find(const char *isa, bench_level *levels);

#endif
