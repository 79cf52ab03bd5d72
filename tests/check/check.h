/* check.h - runs one kernel on hard inputs at every level of this machine, and holds it to computed bounds.
 *
 * A case is a number: it alone decides kind, sizes and content. A case makes its arrays, asks tests/reference
 * for the values in float64 and the bounds beside them, then runs the kernel level by level.
 *
 * Every array ends where its contract says, at a page that cannot be touched, or begins right after one; what
 * lies between an array and the other end of its pages must stay as it is. Inputs can only be read.
 *
 * SPLATFIT_SEED=N or N-M runs these cases alone; SPLATFIT_QUICK=1 a part of them.
 */
#ifndef TESTS_CHECK_H
#define TESTS_CHECK_H

#include "../testing.h"

#include "../reference/bounded.h"
#include "../reference/random.h"
#include "kernels/kernels.h"

/* Bounds are of first order, and a level may take another order of operations than the reference. */
#define CHECK_SLACK 2.0

/* More results than this, as a fraction, must not lie within their bound of a threshold. */
#define CHECK_MOST_CLIFFS 0.01

enum { CHECK_LEVELS = 8, CHECK_ARRAYS = 64, CHECK_PARTS = 4, CHECK_RESULTS = 32 };

typedef struct check_kernel {
    const char *name;
    int index; /* SF_KERNEL_... */
} check_kernel;

/* What was seen of one kernel. */
typedef struct check_part {
    size_t values, cliffs, failures;
    struct {
        const char *what; /* a string constant */
        double worst;     /* error in bounds */
    } results[CHECK_RESULTS];
} check_part;

typedef struct check_level {
    const char *name;
    sf_kernels kernels;
    check_part parts[CHECK_PARTS];
} check_level;

typedef struct check_array {
    const char *name;
    uint8_t *pages; /* guard, body, guard */
    size_t body;    /* bytes between the guards */
    uint8_t *data;
    size_t size;
    int output;
} check_array;

typedef struct check {
    const check_kernel *kernels;
    size_t kernel_count;
    size_t kernel; /* at hand */
    uint64_t seed; /* of the case at hand */
    sf_rng rng;
    check_level levels[CHECK_LEVELS];
    size_t level_count;
    check_level *level; /* at hand */
    check_array arrays[CHECK_ARRAYS];
    size_t array_count;
} check;

/* Runs case c->seed at all levels of c. */
typedef void (*check_case)(check *c);

/* Cases 0 .. cases-1 of kernels that belong together, at the levels that have one of them of their own; fails
 * the test in progress where a level did. */
void check_kernels(const check_kernel *kernels, size_t count, size_t cases, check_case run);

/* Whether fewer and smaller cases are wanted. */
int check_is_quick(void);

/* Arrays of the case. Inputs are 0 and can be written until the first kernel runs; outputs are all-ones
 * bytes, anew for each level. */
void *check_input(check *c, const char *name, size_t count, size_t size, size_t alignment);
void *check_output(check *c, const char *name, size_t count, size_t size, size_t alignment);
/* As the contract has arrays of floats. */
float *check_floats_in(check *c, const char *name, size_t count);
float *check_floats_out(check *c, const char *name, size_t count);
/* Done after each case. */
void check_free(check *c);

/* Takes level `l` in hand: outputs are as new. */
void check_at(check *c, size_t l);
/* Runs `call` with the level's table, for kernel `kernel` of c's; what is noted from here on is of that one.
 * 0, and a failure noted, if it touched what it must not. */
int check_call(check *c, size_t kernel, void (*call)(const sf_kernels *kernels, void *args), void *args);

/* |got - want| <= CHECK_SLACK want.e, at the level in hand. */
void check_near(check *c, const char *what, size_t at, double got, bounded want);
/* Anything else that must be. */
void check_that(check *c, int holds, const char *what, size_t at);
/* Whether `count` bytes at `data` are still as check_at left them. */
int check_untouched(const void *data, size_t count);
/* Notes results within their bound of a threshold, which may go either way. */
void check_cliffs(check *c, size_t count);

/* Uniform in [least, most), and of the logarithm. */
double check_between(check *c, double least, double most);
double check_magnitude(check *c, double least, double most);
/* One of 0 .. n-1. */
size_t check_pick(check *c, size_t n);

/* A splat, but for its colour and depth, from a mean on the screen, two standard deviations and the first
 * one's direction, and an opacity. */
sf_splat check_splat(const double mean[2], const double size[2], double angle, double opacity);

#endif
