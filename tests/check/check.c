/* check.c - see check.h. */
#define _GNU_SOURCE
#include "check.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { MOST_REPORTS = 5, CANARY = 0xa5, FRESH = 0xff };

int check_is_quick(void) {
    const char *quick = getenv("SPLATFIT_QUICK");
    return quick && *quick && strcmp(quick, "0");
}

double check_between(check *c, double least, double most) {
    return test_random_between(&c->rng, least, most);
}

double check_magnitude(check *c, double least, double most) {
    return exp(check_between(c, log(least), log(most)));
}

size_t check_pick(check *c, size_t n) { return (size_t)sf_rng_below(&c->rng, n); }

/* M.1 from the covariance on. */
sf_splat check_splat(const double mean[2], const double size[2], double angle, double opacity) {
    double c0 = cos(angle), s0 = sin(angle), xx = size[0] * size[0], yy = size[1] * size[1];
    double a = c0 * c0 * xx + s0 * s0 * yy + SF_LOW_PASS, b = c0 * s0 * (xx - yy);
    double c = s0 * s0 * xx + c0 * c0 * yy + SF_LOW_PASS;
    double det = xx * yy + SF_LOW_PASS * (xx + yy) + SF_LOW_PASS * SF_LOW_PASS;
    double r2 = fmax((log2(opacity) + SF_LOG2_255) * SF_WHITEN_UNDO, 0);
    return (sf_splat){.u = (float)mean[0],
                      .v = (float)mean[1],
                      .l00 = (float)(SF_WHITEN * sqrt(c / det)),
                      .l01 = (float)(-SF_WHITEN * b / sqrt(c * det)),
                      .m = (float)(SF_WHITEN / sqrt(c)),
                      .log2_opacity = (float)log2(opacity),
                      .slope = (float)(b / c),
                      .reach = (float)(r2 * det / c),
                      .squeeze = (float)(det / (c * c)),
                      .lean = (float)(b * sqrt(r2 / a)),
                      .half_width = (float)sqrt(r2 * a),
                      .half_height = (float)sqrt(r2 * c)};
}

/* ---- what is said of a level ----------------------------------------------------------------------------
 */

static check_part *part_of(check *c) { return &c->level->parts[c->kernel]; }

/* Notes a failure; says whether it is still to be told. */
static int note_failure(check *c) {
    if (part_of(c)->failures++ >= MOST_REPORTS) return 0;
    print_error("%s %s, SPLATFIT_SEED=%llu: ", c->kernels[c->kernel].name, c->level->name,
                (unsigned long long)c->seed);
    return 1;
}

void check_near(check *c, const char *what, size_t at, double got, bounded want) {
    check_part *part = part_of(c);
    double error = fabs(got - want.v), bound = CHECK_SLACK * want.e, share = error > 0 ? error / bound : 0;
    part->values++;
    if (!(error <= bound) && note_failure(c))
        print_error("%s[%zu] is %.9g, not %.9g +- %.2g\n", what, at, got, want.v, bound);
    size_t k = 0;
    while (k + 1 < CHECK_RESULTS && part->results[k].what && strcmp(part->results[k].what, what)) k++;
    part->results[k].what = what;
    part->results[k].worst = fmax(part->results[k].worst, share);
}

void check_that(check *c, int holds, const char *what, size_t at) {
    part_of(c)->values++;
    if (!holds && note_failure(c)) print_error("%s, at %zu\n", what, at);
}

void check_cliffs(check *c, size_t count) { part_of(c)->cliffs += count; }

int check_untouched(const void *data, size_t count) {
    const uint8_t *bytes = data;
    for (size_t i = 0; i < count; i++)
        if (bytes[i] != FRESH) return 0;
    return 1;
}

/* ---- arrays ---------------------------------------------------------------------------------------------
 */

static size_t page_size(void) { return (size_t)sysconf(_SC_PAGESIZE); }

static void *array(check *c, const char *name, size_t size, size_t alignment, int output) {
    assert_true(c->array_count < CHECK_ARRAYS);
    check_array *a = &c->arrays[c->array_count++];
    size_t page = page_size(), body = (size + alignment + page - 1) / page * page;
    uint8_t *pages = mmap(NULL, body + 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_true(pages != MAP_FAILED);
    assert_int_equal(mprotect(pages, page, PROT_NONE), 0);
    assert_int_equal(mprotect(pages + page + body, page, PROT_NONE), 0);
    size_t offset = c->seed % 2 ? 0 : (body - size) / alignment * alignment;
    *a = (check_array){name, pages, body, pages + page + offset, size, output};
    memset(pages + page, CANARY, body);
    memset(a->data, output ? FRESH : 0, size);
    return a->data;
}

void *check_input(check *c, const char *name, size_t count, size_t size, size_t alignment) {
    return array(c, name, count * size, alignment, 0);
}

void *check_output(check *c, const char *name, size_t count, size_t size, size_t alignment) {
    return array(c, name, count * size, alignment, 1);
}

float *check_floats_in(check *c, const char *name, size_t count) {
    return check_input(c, name, count, sizeof(float), 64);
}

float *check_floats_out(check *c, const char *name, size_t count) {
    return check_output(c, name, count, sizeof(float), 64);
}

void check_free(check *c) {
    for (size_t i = 0; i < c->array_count; i++)
        munmap(c->arrays[i].pages, c->arrays[i].body + 2 * page_size());
    c->array_count = 0;
}

static void protect_inputs(check *c) {
    for (size_t i = 0; i < c->array_count; i++) {
        const check_array *a = &c->arrays[i];
        if (!a->output) assert_int_equal(mprotect(a->pages + page_size(), a->body, PROT_READ), 0);
    }
}

void check_at(check *c, size_t l) {
    if (l == 0) protect_inputs(c);
    c->level = &c->levels[l];
    c->kernel = 0;
    for (size_t i = 0; i < c->array_count; i++)
        if (c->arrays[i].output) memset(c->arrays[i].data, FRESH, c->arrays[i].size);
}

static void check_canaries(check *c) {
    for (size_t i = 0; i < c->array_count; i++) {
        const check_array *a = &c->arrays[i];
        for (uint8_t *at = a->pages + page_size(), *end = at + a->body; a->output && at < end; at++) {
            if (at == a->data) at += a->size;
            if (at == end || *at == CANARY) continue;
            if (note_failure(c)) print_error("wrote beside %s, at byte %td\n", a->name, at - a->data);
            break;
        }
    }
}

/* ---- running --------------------------------------------------------------------------------------------
 */

static sigjmp_buf back;
static void *volatile touched;

static void on_fault(int signal, siginfo_t *info, void *context) {
    (void)signal, (void)context;
    touched = info->si_addr;
    siglongjmp(back, 1);
}

static void report_fault(check *c) {
    if (!note_failure(c)) return;
    uint8_t *at = touched;
    for (size_t i = 0; i < c->array_count; i++) {
        const check_array *a = &c->arrays[i];
        if (at < a->pages || at >= a->pages + a->body + 2 * page_size()) continue;
        print_error("touched %s at byte %td of %zu\n", a->name, at - a->data, a->size);
        return;
    }
    print_error("touched %p, which is in none of its arrays\n", (void *)at);
}

int check_call(check *c, size_t kernel, void (*call)(const sf_kernels *kernels, void *args), void *args) {
    struct sigaction act = {.sa_sigaction = on_fault, .sa_flags = SA_SIGINFO}, segv, bus;
    int returned = 0;
    c->kernel = kernel;
    sigaction(SIGSEGV, &act, &segv);
    sigaction(SIGBUS, &act, &bus);
    if (sigsetjmp(back, 1) == 0) {
        call(&c->level->kernels, args);
        returned = 1;
    } else {
        report_fault(c);
        returned = 0;
    }
    sigaction(SIGSEGV, &segv, NULL);
    sigaction(SIGBUS, &bus, NULL);
    if (returned) check_canaries(c);
    return returned;
}

/* The levels that have one of the kernels; those that the machine lacks are named. */
static void find_levels(check *c) {
    sf_isa_info info;
    for (size_t i = 0; !sf_isa_describe(i, &info); i++) {
        unsigned mask;
        if (sf_cpu_choose(info.name, &mask)) {
            print_message("%s %s: not on this machine, skipped\n", c->kernels[0].name, info.name);
            continue;
        }
        check_level l = {.name = info.name};
        int own = 0;
        sf_kernels_init(&l.kernels, mask);
        for (size_t k = 0; k < c->kernel_count; k++)
            own |= !strcmp(l.kernels.level[c->kernels[k].index], info.name);
        if (own) c->levels[c->level_count++] = l;
    }
}

/* 1: failed. */
static int report(const char *kernel, const char *level, const check_part *part) {
    double cliffs = part->cliffs ? (double)part->cliffs / (double)(part->values + part->cliffs) : 0;
    int failed = part->failures > 0 || part->values == 0 || cliffs > CHECK_MOST_CLIFFS;
    print_message("%s %s:", kernel, level);
    for (size_t k = 0; k < CHECK_RESULTS && part->results[k].what; k++)
        print_message("%s %s %.2f", k ? "," : "", part->results[k].what, part->results[k].worst);
    print_message("%s%zu values, %zu on a cliff (%.3f %%)%s\n",
                  part->results[0].what ? " of the bound; " : " ", part->values, part->cliffs, 100 * cliffs,
                  failed ? ": FAILED" : "");
    return failed;
}

void check_kernels(const check_kernel *kernels, size_t count, size_t cases, check_case run) {
    static check c;
    memset(&c, 0, sizeof c);
    c.kernels = kernels;
    c.kernel_count = count;
    find_levels(&c);
    /* primes: kinds and sizes, which are remainders of the number, are met all the same */
    uint64_t first = 0, end = cases, step = !check_is_quick() || cases <= 500 ? 1 : cases <= 1200 ? 7 : 13;
    const char *wanted = getenv("SPLATFIT_SEED");
    if (wanted && *wanted) {
        char *rest;
        first = strtoull(wanted, &rest, 10);
        end = 1 + (*rest == '-' ? strtoull(rest + 1, NULL, 10) : first);
        step = 1;
    }
    for (c.seed = first; c.seed < end; c.seed += step) {
        sf_rng_seed(&c.rng, c.seed);
        run(&c);
        check_free(&c);
    }
    int failed = 0;
    for (size_t k = 0; k < count; k++)
        for (size_t l = 0; l < c.level_count; l++)
            failed += report(kernels[k].name, c.levels[l].name, &c.levels[l].parts[k]);
    assert_int_equal(failed, 0);
}
