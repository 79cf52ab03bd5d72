/* bench.c - the order of the measurements, and what they share. */
#include "bench.h"

#include <string.h>

#include "../base/clock.h"
#include "../base/pool.h"

void bench_say(const bench_options *options, const char *what) {
    if (!options->progress) return;
    fprintf(options->progress, "measuring: %s\n", what);
    fflush(options->progress);
}

int bench_goes_on(const bench_options *options, int round, int rounds, double start) {
    if (!options->brief) return round < rounds;
    return round == 0 || (round < 3 && round < rounds && sf_clock() - start < 15);
}

sf_status bench_context(sf_context *ctx, const char *isa, int threads, sf_context **out) {
    sf_context_options options = {.isa = isa, .threads = threads};
    sf_status status = sf_context_create(out, &options);
    return status ? sf_fail(ctx, status, "a context of %d threads at %s: %s", threads, isa,
                            sf_status_text(status))
                  : SF_OK;
}

sf_status bench_begin(sf_context *ctx, const bench_options *options, bench_report *report) {
    memset(report, 0, sizeof *report);
    report->quick = options->quick;
    bench_machine_describe(&report->machine, sf_pool_threads(ctx->pool));
    bench_machine_clock(&report->machine);
    report->levels = bench_levels_find(options->isa, report->level);
    return report->levels ? SF_OK : sf_fail(ctx, SF_ERR_UNSUPPORTED, "no level of kernels");
}

void bench_end(bench_report *report) {
    bench_machine_clock(&report->machine);
    report->machine.load_end = bench_machine_load();
}
