/* report.c - a report as text, and the figures that text, JSON and charts share. */
#include "report.h"

#include <math.h>
#include <string.h>

double bench_kernel_ghz(const bench_report *report) { return bench_machine_ghz(&report->machine, 0); }

double bench_roof_share(const bench_report *report, int level, const bench_kernel *kernel) {
    if (kernel->seconds <= 0) return 0;
    if (kernel->operations > 0 && report->level[level].gflops[0] > 0)
        return kernel->operations / kernel->seconds * 1e-9 / report->level[level].gflops[0];
    if (kernel->bytes > 0 && report->bandwidth.update[0] > 0)
        return kernel->bytes / kernel->seconds * 1e-9 / report->bandwidth.update[0];
    return 0;
}

double bench_floor(const bench_report *report, const bench_step_times *step, int stage) {
    int many = step->threads > 1;
    double flops = report->level[step->level].gflops[many] * 1e9;
    double bytes = report->bandwidth.update[many] * 1e9;
    return flops > 0 && bytes > 0 ? bench_stage_floor(step, stage, flops, bytes) : 0;
}

double bench_far_gbs(const bench_report *report) {
    const bench_step_times *far = &report->far;
    double seconds = far->seconds[STAGE_UPDATE];
    return seconds > 0 ? bench_stage_floor(far, STAGE_UPDATE, 1, 1) / seconds * 1e-9 : 0;
}

static void print_machine(const bench_report *report, FILE *out) {
    const bench_machine *m = &report->machine;
    double least = INFINITY, most = 0;
    for (int i = 0; i < m->samples; i++) {
        least = fmin(least, m->ghz[i]);
        most = fmax(most, m->ghz[i]);
    }
    fprintf(out, "machine  %s, %d CPUs, %d threads in use\n", m->cpu, m->cpus, m->threads);
    fprintf(out, "         largest cache %.1f MB, %.0f MB of memory available\n", m->last_cache * 1e-6,
            m->memory * 1e-6);
    fprintf(out, "         load average %.2f at the start, %.2f at the end\n", m->load_start, m->load_end);
    fprintf(out, "         clock %.2f GHz (median of %d; %.2f .. %.2f)\n", bench_kernel_ghz(report),
            m->samples, least, most);
    if (report->quick) fprintf(out, "         --quick: small scenes, few rounds; not for quoting\n");
}

static void print_roofs(const bench_report *report, FILE *out) {
    const bench_bandwidth *b = &report->bandwidth;
    if (!(b->bytes > 0)) return;
    fprintf(out, "\n%-26s %12s %12s\n", "roofs", "one thread", "all threads");
    for (int i = 0; i < report->levels; i++)
        fprintf(out, "%-10s multiply-add %14.1f %12.1f GFLOP/s\n", report->level[i].name,
                report->level[i].gflops[0], report->level[i].gflops[1]);
    const double *rows[] = {b->read, b->write, b->update};
    static const char *const names[] = {"read", "write", "update"};
    for (int i = 0; i < 3; i++)
        fprintf(out, "memory     %-13s %13.1f %12.1f GB/s\n", names[i], rows[i][0], rows[i][1]);
    fprintf(out, "(memory: arrays of %.0f MB; update counts bytes read and bytes written)\n",
            b->bytes * 1e-6);
}

static void print_share(FILE *out, double share) {
    if (share > 0)
        fprintf(out, " %6.0f %%", 100 * share);
    else
        fprintf(out, " %8s", "-");
}

static void print_or_dash(FILE *out, double value) {
    if (value > 0)
        fprintf(out, " %9.2f", value);
    else
        fprintf(out, " %9s", "-");
}

static void print_kernel(const bench_report *report, int row, int level, FILE *out) {
    const bench_kernel *k = &report->kernel[level][row], *scalar = &report->kernel[0][row];
    if (k->seconds <= 0) return;
    double ns = 1e9 * k->seconds / k->units;
    fprintf(out, "%-22s %-8s %10.3f %10.2f", k->name, report->level[level].name, ns,
            ns * bench_kernel_ghz(report));
    print_or_dash(out, scalar->seconds > 0 ? scalar->seconds / k->seconds : 0);
    print_share(out, bench_roof_share(report, level, k));
    print_or_dash(out, k->instructions);
    fprintf(out, "  %s\n", k->unit);
}

static void print_kernels(const bench_report *report, FILE *out) {
    const bench_load *load = &report->load;
    if (!report->kernels) return;
    double pixels = (double)load->width * load->height;
    fprintf(out, "\nscene    %zu Gaussians at %dx%d: %.0f entries, %.1f contributing pairs a pixel,\n",
            load->gaussians, load->width, load->height, load->entries, load->contributing / pixels);
    fprintf(out, "         %.1f %% of the pairs evaluated in blocks of 4x4 px contribute\n",
            100 * load->contributing / load->evaluated_4x4);
    fprintf(out, "\n%-22s %-8s %10s %10s %9s %8s %9s\n", "kernel, one thread", "level", "ns a unit", "cycles",
            "x scalar", "of roof", "instr.");
    for (int row = 0; row < report->kernels; row++)
        for (int level = 0; level < report->levels; level++) print_kernel(report, row, level, out);
}

static void print_accuracy(const bench_report *report, FILE *out) {
    if (!report->accuracies) return;
    fprintf(out, "\nblending against float64, %d of %d pixels left out for a threshold too near\n",
            report->accuracy_left_out, report->accuracy_pixels);
    fprintf(out, "%-8s %6s %10s %10s %12s %12s %13s %13s\n", "level", "degree", "ns a pair", "backward",
            "picture rms", "picture max", "gradient rms", "gradient max");
    for (int i = 0; i < report->accuracies; i++) {
        const bench_accuracy *a = &report->accuracy[i];
        double pairs = report->load.contributing;
        fprintf(out, "%-8s %6d %10.3f %10.3f %12.2e %12.2e %13.2e %13.2e\n", report->level[a->level].name,
                a->degree, 1e9 * a->seconds / pairs, 1e9 * a->seconds_bwd / pairs, a->picture_rms,
                a->picture_max, a->gradient_rms, a->gradient_max);
    }
}

static void print_step_head(const char *title, FILE *out) {
    fprintf(out, "\n%-34s", title);
    for (int k = 0; k < STAGES; k++) fprintf(out, " %9s", bench_stage_names[k]);
    fprintf(out, " %8s %8s\n", "speed-up", "x scalar");
}

/* The same size and level on one thread, or the same size and threads at scalar. */
static const bench_step_times *find_step(const bench_step_times *list, int n, const bench_step_times *like,
                                         int level, int threads) {
    for (int i = 0; i < n; i++)
        if (list[i].gaussians == like->gaussians && list[i].width == like->width && list[i].level == level &&
            list[i].threads == threads)
            return &list[i];
    return NULL;
}

static void print_ratio(FILE *out, const bench_step_times *base, const bench_step_times *step) {
    if (base && base != step && step->seconds[STAGE_TOTAL] > 0)
        fprintf(out, " %8.2f", base->seconds[STAGE_TOTAL] / step->seconds[STAGE_TOTAL]);
    else
        fprintf(out, " %8s", "-");
}

static void print_step(const bench_report *report, const bench_step_times *list, int n,
                       const bench_step_times *step, FILE *out) {
    char size[32];
    snprintf(size, sizeof size, "%zu, %dx%d", step->gaussians, step->width, step->height);
    fprintf(out, "%-18s %-7s %3d thr.", step->width ? size : "", report->level[step->level].name,
            step->threads);
    for (int k = 0; k < STAGES; k++) fprintf(out, " %9.3f", 1e3 * step->seconds[k]);
    print_ratio(out, find_step(list, n, step, step->level, 1), step);
    print_ratio(out, find_step(list, n, step, 0, step->threads), step);
    fprintf(out, "\n");
}

static void print_floors(const bench_report *report, const bench_step_times *step, FILE *out) {
    if (!(step->evaluated > 0) || step->level != report->levels - 1 || !(report->bandwidth.bytes > 0)) return;
    fprintf(out, "%-34s", "  the roof's time is, of it");
    for (int k = 0; k < STAGE_TOTAL; k++)
        fprintf(out, " %7.0f %%", 100 * bench_floor(report, step, k) / step->seconds[k]);
    fprintf(out, "\n");
}

static void print_stages(const bench_report *report, FILE *out) {
    const bench_step_times *far = &report->far;
    double gbs = bench_far_gbs(report), memory = report->bandwidth.update[0];
    if (!report->stages) return;
    print_step_head("stages, one thread, ms", out);
    for (int i = 0; i < report->stages; i++) {
        print_step(report, report->stage, report->stages, &report->stage[i], out);
        print_floors(report, &report->stage[i], out);
    }
    fprintf(out, "update beyond the caches, %zu Gaussians, %s: %.1f ms, %.2f GB/s", far->gaussians,
            report->level[far->level].name, 1e3 * far->seconds[STAGE_UPDATE], gbs);
    if (memory > 0) fprintf(out, ", %.2f times the time of memory's update", memory / gbs);
    fprintf(out, "\n");
}

static void print_steps(const bench_report *report, FILE *out) {
    if (!report->steps) return;
    print_step_head("steps, ms", out);
    for (int i = 0; i < report->steps; i++) {
        print_step(report, report->step, report->steps, &report->step[i], out);
        print_floors(report, &report->step[i], out);
    }
}

static void print_fitted(const bench_report *report, FILE *out) {
    const bench_fitted *f = &report->fitted;
    if (!f->count) return;
    fprintf(out, "\nfitted model: %zu Gaussians, %zu training views, the first %dx%d; means over the views\n",
            f->gaussians, f->views, f->width, f->height);
    print_step_head("steps, ms", out);
    for (int i = 0; i < f->count; i++) print_step(report, f->times, f->count, &f->times[i], out);
    for (int i = 0; i < f->count; i++)
        fprintf(out, "%-8s %d threads: median of the views %.2f ms a step, %d rounds\n",
                report->level[f->times[i].level].name, f->times[i].threads, 1e3 * f->times[i].median_total,
                f->times[i].rounds);
}

static void print_photos(const bench_report *report, FILE *out) {
    if (!report->photo_rows) return;
    fprintf(
        out,
        "\nfeatures of a photo of %dx%d and matches with another, one thread; the scale space begins at\n",
        report->photos[0].width, report->photos[0].height);
    fprintf(out, "%-8s %-18s %9s %10s %7s %9s %10s %7s %10s\n", "level", "the picture", "features", "ms",
            "x scalar", "matches", "ms", "x scalar", "GMAC/s");
    for (int i = 0; i < report->photo_rows; i++) {
        const bench_photos *p = &report->photos[i], *scalar = &report->photos[i % BENCH_PHOTO_ROWS];
        fprintf(out, "%-8s %-18s %9.0f %10.2f %7.1f %9.0f %10.2f %7.1f %10.1f\n",
                report->level[p->level].name, p->start, p->features, 1e3 * p->features_seconds,
                scalar->features_seconds / p->features_seconds, p->matches, 1e3 * p->match_seconds,
                scalar->match_seconds / p->match_seconds, 128e-9 * p->products / p->match_seconds);
    }
}

void bench_print(const bench_report *report, FILE *out) {
    print_machine(report, out);
    print_roofs(report, out);
    print_kernels(report, out);
    print_stages(report, out);
    print_accuracy(report, out);
    print_steps(report, out);
    print_photos(report, out);
    print_fitted(report, out);
}

/* The rows that a name of the kernels' table stands for. */
static void take_instructions(bench_report *report, const char *level, const char *kernel, double count) {
    for (int i = 0; i < report->levels; i++)
        for (int row = 0; row < report->kernels && !strcmp(report->level[i].name, level); row++) {
            bench_kernel *k = &report->kernel[i][row];
            size_t n = strlen(kernel); /* the row of that name, or of what was counted of two */
            if (!strncmp(k->name, kernel, n) && (!k->name[n] || !strcmp(k->name + n, ", in cache")))
                k->instructions = count;
        }
}

sf_status bench_read_instructions(sf_context *ctx, const char *path, bench_report *report) {
    char level[32], kernel[32];
    double count;
    FILE *file = fopen(path, "r");
    if (!file) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be opened", path);
    while (fscanf(file, "%31s %31s %lf", level, kernel, &count) == 3)
        take_instructions(report, level, kernel, count);
    int whole = feof(file);
    fclose(file);
    return whole ? SF_OK : sf_fail(ctx, SF_ERR_FORMAT, "%s: not lines of level, kernel, instructions", path);
}
