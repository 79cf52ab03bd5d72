/* report.h - a report as text, as JSON and as charts. */
#ifndef BENCH_REPORT_H
#define BENCH_REPORT_H

#include <jansson.h>

#include "bench.h"

/* The sections that have figures, as tables. */
void bench_print(const bench_report *report, FILE *out);

/* brief.c: what fits into a message: machine, levels, ns a unit, a whole step, accuracy, as Markdown. */
void bench_markdown(const bench_report *report, FILE *out);

/* One object: machine, kernels, steps, accuracy; roofs, scene, stages, update_beyond_caches and model where
 * they were measured. NULL: out of memory. */
json_t *bench_json(const bench_report *report);

/* Takes over instructions a unit from lines "level kernel instructions", as tests/bench/callgrind.sh
 * writes them. */
sf_status bench_read_instructions(sf_context *ctx, const char *path, bench_report *report);

/* Takes over the accuracy of another build from what bench_json wrote there, of the levels that are measured
 * here. SF_ERR_IO, SF_ERR_FORMAT: nothing of it is such a figure. */
sf_status bench_read_before(sf_context *ctx, const char *path, bench_report *report);

/* charts.c: each level's and polynomial's error over its speed, and dashed that of the build before; each
 * stage's time beside its roof. */
sf_status bench_chart_accuracy(sf_context *ctx, const bench_report *report, const char *path);
sf_status bench_chart_roofs(sf_context *ctx, const bench_report *report, const char *path);

/* Figures that the tables, the JSON and the charts share; 0: not measured. */
double bench_kernel_ghz(const bench_report *report);
double bench_roof_share(const bench_report *report, int level, const bench_kernel *kernel);
double bench_floor(const bench_report *report, const bench_step_times *step, int stage);
/* GB/s of project_bwd and Adam beyond the caches. */
double bench_far_gbs(const bench_report *report);

#endif
