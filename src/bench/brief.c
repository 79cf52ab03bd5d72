/* brief.c - a report that fits into a message, as Markdown. */
#include <splatfit/context.h>

#include "report.h"

#include <math.h>
#include <string.h>

static void head(const bench_report *report, const char *first, FILE *out) {
    fprintf(out, "\n| %s |", first);
    for (int i = 0; i < report->levels; i++) fprintf(out, " %s |", report->level[i].name);
    fprintf(out, "\n| --- |");
    for (int i = 0; i < report->levels; i++) fprintf(out, " --- |");
    fprintf(out, "\n");
}

static void cell(FILE *out, double value) {
    if (value >= 1000)
        fprintf(out, " %.0f |", value);
    else if (value > 0)
        fprintf(out, " %.3g |", value);
    else
        fprintf(out, " |");
}

static void machine(const bench_report *report, FILE *out) {
    const bench_machine *m = &report->machine;
    fprintf(out, "### splatfit %s on %s\n\n", sf_version(), m->cpu);
    fprintf(out, "%d CPUs, %d threads in use, %.2f GHz measured, %.1f GB of memory free", m->cpus, m->threads,
            bench_kernel_ghz(report), m->memory * 1e-9);
    if (m->load_start >= 0) fprintf(out, ", load %.1f to %.1f", m->load_start, m->load_end);
    fprintf(out, ". Levels:");
    for (int i = 0; i < report->levels; i++) fprintf(out, "%s %s", i ? "," : "", report->level[i].name);
    fprintf(out, ".%s\n", report->quick ? " Measured with --quick: not for quoting." : "");
}

/* The kernels of a step of a fit; what else there is, make bench tells. */
static void kernels(const bench_report *report, FILE *out) {
    static const char *const names[] = {"project",   "spans",       "blend", "loss",
                                        "blend_bwd", "project_bwd", "adam"};
    if (!report->kernels) return;
    fprintf(out, "\nOne thread, %zu Gaussians at %dx%d, ns a unit:\n", report->load.gaussians,
            report->load.width, report->load.height);
    head(report, "kernel, unit", out);
    for (size_t k = 0; k < sizeof names / sizeof *names; k++)
        for (int row = 0; row < report->kernels; row++) {
            const bench_kernel *first = &report->kernel[0][row];
            size_t n = strcspn(first->name, ",");
            int own = strlen(names[k]) == n && !strncmp(first->name, names[k], n) && first->seconds > 0;
            if (!own) continue;
            fprintf(out, "| %s, %s |", first->name, first->unit);
            for (int i = 0; i < report->levels; i++) {
                const bench_kernel *kernel = &report->kernel[i][row];
                cell(out, kernel->seconds > 0 ? 1e9 * kernel->seconds / kernel->units : 0);
            }
            fprintf(out, "\n");
        }
}

static void steps(const bench_report *report, FILE *out) {
    if (!report->steps) return;
    fprintf(out, "\nA whole step of a fit, %zu Gaussians at %dx%d, ms:\n", report->step[0].gaussians,
            report->step[0].width, report->step[0].height);
    head(report, "threads", out);
    for (int many = 0; many < 2; many++) {
        int threads = many ? report->machine.threads : 1;
        if (many && threads == 1) continue;
        fprintf(out, "| %d |", threads);
        for (int i = 0; i < report->levels; i++) {
            double seconds = 0;
            for (int k = 0; k < report->steps; k++)
                if (report->step[k].level == i && report->step[k].threads == threads)
                    seconds = report->step[k].seconds[STAGE_TOTAL];
            cell(out, 1e3 * seconds);
        }
        fprintf(out, "\n");
    }
}

static void accuracy(const bench_report *report, FILE *out) {
    if (!report->accuracies) return;
    fprintf(out, "\nBlending against float64, rms of the whole:\n");
    head(report, "of", out);
    for (int gradient = 0; gradient < 2; gradient++) {
        fprintf(out, gradient ? "| gradient |" : "| picture |");
        for (int i = 0; i < report->accuracies; i++) {
            const bench_accuracy *a = &report->accuracy[i];
            if (a->degree == 5) cell(out, gradient ? a->gradient_rms : a->picture_rms);
        }
        fprintf(out, "\n");
    }
}

void bench_markdown(const bench_report *report, FILE *out) {
    machine(report, out);
    kernels(report, out);
    steps(report, out);
    accuracy(report, out);
}
