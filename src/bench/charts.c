/* charts.c - error over speed of blending, and each stage's time beside its roof. */
#include <stdio.h>
#include <string.h>

#include "../chart/svg.h"
#include "report.h"

static const char *color_of(const char *level) {
    static const char *const colors[][2] = {{"scalar", "#8b949e"},
                                            {"sse4", "#d97706"},
                                            {"avx2", "#2f81f7"},
                                            {"avx512", "#2da44e"},
                                            {"neon", "#a371f7"}};
    for (size_t i = 0; i < sizeof colors / sizeof *colors; i++)
        if (!strcmp(colors[i][0], level)) return colors[i][1];
    return SVG_INK;
}

/* Names of what the colours mean, from x on. */
static void legend(svg *s, const bench_report *report, double x, double y) {
    for (int i = 0; i < report->levels; i++) {
        const char *name = report->level[i].name;
        svg_dot(s, x, y - 4, 4, color_of(name));
        svg_text(s, x + 9, y, 12, SVG_START, SVG_INK, name);
        x += 28 + 7.5 * (double)strlen(name);
    }
}

/* A half of the chart of accuracy: forward, or backward. */
typedef struct half {
    const bench_report *report;
    int backward;
    svg_axis x, y;
} half;

static double half_ns(const half *h, const bench_accuracy *a) {
    return 1e9 * (h->backward ? a->seconds_bwd : a->seconds) / a->pairs;
}

static double half_error(const half *h, const bench_accuracy *a) {
    return h->backward ? a->gradient_rms : a->picture_rms;
}

/* A line for each level, of this build or, dashed and with smaller dots, of the one before. */
static void draw_levels(svg *s, const half *h, const bench_accuracy *list, int count, const char *dashes) {
    for (int i = 0; i < count; i++) {
        const bench_accuracy *a = &list[i], *last = i ? a - 1 : a;
        const char *color = color_of(h->report->level[a->level].name);
        double x = svg_axis_at(&h->x, half_ns(h, a)), y = svg_axis_at(&h->y, half_error(h, a));
        if (last != a && last->level == a->level)
            svg_line(s, svg_axis_at(&h->x, half_ns(h, last)), svg_axis_at(&h->y, half_error(h, last)), x, y,
                     &(svg_style){.stroke = color, .width = 1.2, .dashes = dashes});
        svg_dot(s, x, y, dashes ? 2 : 4, color);
    }
}

static void draw_half(svg *s, const half *h) {
    const bench_report *report = h->report;
    svg_axes(s, &h->x, &h->y, h->backward ? "gradient (backward)" : "picture (forward)",
             "ns a contributing pair, one thread", h->backward ? NULL : "rms error / rms, against float64");
    draw_levels(s, h, report->before, report->befores, "4 3");
    draw_levels(s, h, report->accuracy, report->accuracies, NULL);
    for (int i = 0; i < report->accuracies; i++) {
        const bench_accuracy *a = &report->accuracy[i];
        char degree[8];
        snprintf(degree, sizeof degree, "%d", a->degree);
        svg_label(s, svg_axis_at(&h->x, half_ns(h, a)), svg_axis_at(&h->y, half_error(h, a)), 11,
                  color_of(report->level[a->level].name), degree);
    }
}

/* Both halves have one scale of errors. */
static void see(half *h, const bench_accuracy *list, int count) {
    for (int i = 0; i < count; i++) {
        svg_axis_see(&h->x, half_ns(h, &list[i]));
        svg_axis_see(&h->y, list[i].picture_rms);
        svg_axis_see(&h->y, list[i].gradient_rms);
    }
}

static void scale_halves(const bench_report *report, half halves[2]) {
    for (int k = 0; k < 2; k++) {
        half *h = &halves[k];
        *h = (half){.report = report, .backward = k};
        see(h, report->accuracy, report->accuracies);
        see(h, report->before, report->befores);
        svg_axis_round(&h->x);
        svg_axis_round(&h->y);
        h->x.from = 78 + 410 * k, h->x.to = h->x.from + 350;
        h->y.from = 360, h->y.to = 92;
    }
}

sf_status bench_chart_accuracy(sf_context *ctx, const bench_report *report, const char *path) {
    svg s;
    half halves[2];
    char title[160];
    if (!report->accuracies) return SF_OK;
    sf_status status = svg_open(&s, ctx, path, 860, 410);
    if (status) return status;
    snprintf(title, sizeof title, "Blending: accuracy against speed - %s", report->machine.cpu);
    svg_text(&s, 78, 26, 15, SVG_START, SVG_INK, title);
    legend(&s, report, 82, 52);
    svg_text(&s, 838, 52, 12, SVG_END, SVG_INK,
             report->befores
                 ? "numbers: degree of the polynomial for exp2 (5 is used); dashed: the build before"
                 : "numbers: degree of the polynomial for exp2 (5 is used)");
    scale_halves(report, halves);
    for (int k = 0; k < 2; k++) draw_half(&s, &halves[k]);
    return svg_close(&s);
}

/* The stages that have a panel, and what bounds them. */
static const struct {
    int stage;
    const char *title;
} panels[] = {
    {STAGE_PROJECT, "project - memory"},           {STAGE_BIN, "bin - memory"},
    {STAGE_BLEND, "blend - multiply-add"},         {STAGE_LOSS, "loss - multiply-add"},
    {STAGE_BLEND_BWD, "blend_bwd - multiply-add"}, {STAGE_UPDATE, "update - memory"},
};
enum { PANELS = sizeof panels / sizeof *panels, ACROSS = 3 };

/* The sizes at which the work was counted: the best level, one thread. */
static int sizes_of(const bench_report *report, const bench_step_times *list[BENCH_STEPS_MOST]) {
    int n = 0;
    for (int i = 0; i < report->steps; i++) {
        const bench_step_times *t = &report->step[i];
        if (t->evaluated > 0 && t->threads == 1 && t->level == report->levels - 1) list[n++] = t;
    }
    return n;
}

static void draw_panel(svg *s, const bench_report *report, const bench_step_times *const *list, int n,
                       int panel, const svg_axis *x, const svg_axis *y) {
    int stage = panels[panel].stage;
    const char *color = color_of(report->level[report->levels - 1].name);
    svg_axes(s, x, y, panels[panel].title, panel / ACROSS ? "Gaussians" : NULL, panel % ACROSS ? NULL : "ms");
    for (int i = 0; i < n; i++) {
        double at = svg_axis_at(x, (double)list[i]->gaussians);
        double time = svg_axis_at(y, 1e3 * list[i]->seconds[stage]);
        double floor = svg_axis_at(y, 1e3 * bench_floor(report, list[i], stage));
        if (i) {
            double before = svg_axis_at(x, (double)list[i - 1]->gaussians);
            svg_line(s, before, svg_axis_at(y, 1e3 * list[i - 1]->seconds[stage]), at, time,
                     &(svg_style){.stroke = color, .width = 1.6});
            svg_line(s, before, svg_axis_at(y, 1e3 * bench_floor(report, list[i - 1], stage)), at, floor,
                     &(svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "5 4"});
        }
        svg_dot(s, at, time, 3.5, color);
    }
    for (int i = 0; i < n; i++) {
        char share[16];
        snprintf(share, sizeof share, "%.0f %%",
                 100 * bench_floor(report, list[i], stage) / list[i]->seconds[stage]);
        svg_text(s, svg_axis_at(x, (double)list[i]->gaussians),
                 svg_axis_at(y, 1e3 * list[i]->seconds[stage]) - 9, 11, SVG_MIDDLE, color, share);
    }
}

/* One pair of scales for all panels. */
static void scale_panels(const bench_report *report, const bench_step_times *const *list, int n, svg_axis *x,
                         svg_axis *y) {
    *x = *y = (svg_axis){0};
    for (int i = 0; i < n; i++) {
        svg_axis_see(x, (double)list[i]->gaussians);
        for (int p = 0; p < PANELS; p++) {
            svg_axis_see(y, 1e3 * list[i]->seconds[panels[p].stage]);
            svg_axis_see(y, 1e3 * bench_floor(report, list[i], panels[p].stage));
        }
    }
    x->least *= 0.6, x->most *= 1.6;
    svg_axis_round(y);
    y->most *= 1.5; /* for the shares above the dots */
}

sf_status bench_chart_roofs(sf_context *ctx, const bench_report *report, const char *path) {
    const bench_step_times *list[BENCH_STEPS_MOST];
    int n = sizes_of(report, list);
    svg s;
    svg_axis x, y;
    char title[160], note[160];
    if (!n || !(report->bandwidth.bytes > 0)) return SF_OK;
    sf_status status = svg_open(&s, ctx, path, 900, 590);
    if (status) return status;
    scale_panels(report, list, n, &x, &y);
    snprintf(title, sizeof title, "A step's stages and their roofs - %s", report->machine.cpu);
    snprintf(
        note, sizeof note,
        "%s, one thread, %dx%d: time measured (line) and at the machine's roof (dashed), and their ratio",
        report->level[report->levels - 1].name, list[0]->width, list[0]->height);
    svg_text(&s, 66, 26, 15, SVG_START, SVG_INK, title);
    svg_text(&s, 66, 48, 12, SVG_START, SVG_INK, note);
    for (int p = 0; p < PANELS; p++) {
        svg_axis px = x, py = y;
        px.from = 66 + 280 * (p % ACROSS), px.to = px.from + 245;
        py.from = 292 + 250 * (p / ACROSS), py.to = py.from - 196;
        draw_panel(&s, report, list, n, p, &px, &py);
    }
    return svg_close(&s);
}
