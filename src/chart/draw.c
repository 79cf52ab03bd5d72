/* draw.c - quality against time, times to a quality, moves of the schedule: one picture each. */
#include "parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define MARK_MOST  7.5 /* px, radius at the most Gaussians of a chart */
#define MARK_LEAST 2.8

static void seconds_text(double seconds, char *text, size_t size) {
    snprintf(text, size, seconds < 10 ? "%.2f s" : seconds < 100 ? "%.1f s" : "%.0f s", seconds);
}

/* A chart of quality. */
typedef struct plot {
    svg *s;
    const chart_scene *scene;
    chart_metric metric;
    svg_axis x, y;
    double most_gaussians;
    svg_point *points; /* room for a curve there and back */
    double legend;     /* px down: of the next row */
} plot;

static size_t peers_of(const plot *p) {
    size_t n = 0;
    while (p->metric == CHART_PSNR && chart_peer_of(p->scene->first, n)) n++;
    return n;
}

static void scale(plot *p) {
    p->x = (svg_axis){.from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT};
    p->y = (svg_axis){.from = CHART_TOP + CHART_PLOT, .to = CHART_TOP, .linear = 1};
    p->most_gaussians = 1;
    for (size_t i = 0; i < p->scene->count; i++) {
        const chart_curve *curve = &p->scene->curves[p->metric][i];
        for (size_t k = 0; k < curve->count; k++) {
            svg_axis_see(&p->x, curve->samples[k].seconds);
            svg_axis_see(&p->y, curve->samples[k].least);
            svg_axis_see(&p->y, curve->samples[k].most);
            p->most_gaussians = fmax(p->most_gaussians, curve->samples[k].gaussians);
        }
    }
    for (size_t i = 0; i < peers_of(p); i++)
        for (size_t k = 0; chart_peer_of(p->scene->first, i)->points[k].seconds > 0; k++) {
            svg_axis_see(&p->x, chart_peer_of(p->scene->first, i)->points[k].seconds);
            svg_axis_see(&p->y, chart_peer_of(p->scene->first, i)->points[k].psnr);
        }
    if (p->x.most < 4 * p->x.least) svg_axis_round(&p->x); /* so that there are numbers to read */
    p->x.least *= 0.85, p->x.most *= 1.18;
    svg_axis_round(&p->y);
}

static svg_point place(const plot *p, double seconds, double quality) {
    return (svg_point){svg_axis_at(&p->x, seconds), svg_axis_at(&p->y, quality)};
}

static double mark_radius(const plot *p, double gaussians) {
    return fmax(MARK_LEAST, MARK_MOST * sqrt(gaussians / p->most_gaussians));
}

/* Along the least values, and back along the greatest. */
static void draw_band(const plot *p, const chart_curve *curve) {
    size_t n = curve->count;
    if (curve->runs < 2 || n < 2) return;
    for (size_t i = 0; i < n; i++) {
        p->points[i] = place(p, curve->samples[i].seconds, curve->samples[i].least);
        p->points[2 * n - 1 - i] = place(p, curve->samples[i].seconds, curve->samples[i].most);
    }
    svg_style style = {.fill = chart_color(curve->style), .opacity = 0.28, .kind = "band"};
    svg_polygon(p->s, p->points, 2 * n, &style);
}

static void draw_line(const plot *p, const chart_curve *curve) {
    for (size_t i = 0; i < curve->count; i++)
        p->points[i] = place(p, curve->samples[i].seconds, curve->samples[i].mean);
    svg_style style = {.stroke = chart_color(curve->style),
                       .width = 1.8,
                       .dashes = chart_dashes(curve->style),
                       .kind = "curve"};
    svg_polyline(p->s, p->points, curve->count, &style);
}

static void draw_marks(const plot *p, const chart_curve *curve) {
    for (size_t i = 0; i < curve->count; i++) {
        const chart_sample *sample = &curve->samples[i];
        char note[3 * CHART_TEXT], seconds[32], gaussians[32];
        seconds_text(sample->seconds, seconds, sizeof seconds);
        chart_grouped(sample->gaussians, gaussians, sizeof gaussians);
        snprintf(note, sizeof note,
                 p->metric == CHART_PSNR ? "%s: %s, %.2f dB, %s Gaussians"
                                         : "%s: %s, SSIM %.4f, %s Gaussians",
                 curve->label, seconds, sample->mean, gaussians);
        svg_point at = place(p, sample->seconds, sample->mean);
        svg_style style = {.fill = chart_color(curve->style), .kind = "mark", .note = note};
        svg_mark(p->s, chart_shape(curve->style), at.x, at.y, mark_radius(p, sample->gaussians), &style);
    }
}

static void name_curve(plot *p, const chart_curve *curve) {
    char what[2 * CHART_TEXT];
    int several = curve->runs > 1;
    svg_style line = {
        .stroke = chart_color(curve->style), .width = 1.8, .dashes = chart_dashes(curve->style)};
    svg_style mark = {.fill = chart_color(curve->style)};
    snprintf(what, sizeof what, several ? "%s: mean of %zu runs; band: least to most" : "%s", curve->label,
             curve->runs);
    chart_legend_row(p->s, &p->legend, what, chart_shape(curve->style), &line, &mark);
}

/* Hollow marks of one size: how many Gaussians they had is not known for each. */
static void draw_peer(plot *p, const chart_peer *peer, size_t index) {
    char note[CHART_TEXT + 64];
    svg_shape shape = index % 2 ? SVG_CROSS : SVG_PLUS;
    svg_style line = {
        .stroke = SVG_INK, .width = 1.2, .dashes = index % 2 ? "1 3" : "6 2 1 2", .kind = "peer"};
    svg_style mark = {.fill = "none", .stroke = SVG_INK, .width = 1.2, .kind = "peer-mark", .note = note};
    svg_point at[sizeof peer->points / sizeof *peer->points];
    size_t n = 0;
    for (; peer->points[n].seconds > 0; n++) at[n] = place(p, peer->points[n].seconds, peer->points[n].psnr);
    svg_polyline(p->s, at, n, &line);
    for (size_t i = 0; i < n; i++) {
        snprintf(note, sizeof note, "%s: %g s, %.1f dB", peer->name, peer->points[i].seconds,
                 peer->points[i].psnr);
        svg_mark(p->s, shape, at[i].x, at[i].y, 4.5, &mark);
    }
    line.kind = NULL, mark.kind = NULL, mark.note = NULL;
    chart_legend_row(p->s, &p->legend, peer->name, shape, &line, &mark);
    chart_row_text(p->s, CHART_LEFT + 70, p->legend - 2, peer->source);
    p->legend += CHART_ROW;
}

static void name_sizes(plot *p) {
    char most[32], part[32], what[128];
    svg_style mark = {.fill = SVG_INK};
    double y = p->legend - 4, small = p->most_gaussians / 8;
    chart_grouped(small, part, sizeof part);
    chart_grouped(p->most_gaussians, most, sizeof most);
    svg_mark(p->s, SVG_CIRCLE, CHART_LEFT + 12, y, mark_radius(p, small), &mark);
    svg_mark(p->s, SVG_CIRCLE, CHART_LEFT + 32, y, mark_radius(p, p->most_gaussians), &mark);
    snprintf(what, sizeof what, "area of a mark: the number of Gaussians, here %s and %s", part, most);
    svg_text(p->s, CHART_LEFT + 54, p->legend, 12, SVG_START, SVG_INK, what);
}

sf_status chart_draw_quality(const chart_scene *scene, chart_metric metric, sf_writer *out) {
    svg s;
    plot p = {.s = &s, .scene = scene, .metric = metric, .legend = CHART_TOP + CHART_PLOT + 62};
    size_t longest = 0, rows = 1;
    for (size_t i = 0; i < scene->count; i++)
        if (scene->curves[metric][i].count > longest) longest = scene->curves[metric][i].count;
    p.points = sf_alloc(scene->input->ctx, 2 * longest, sizeof *p.points);
    if (!p.points) return SF_ERR_MEMORY;
    rows += scene->count + 2 * peers_of(&p);
    svg_begin(&s, out, CHART_WIDTH, CHART_TOP + CHART_PLOT + 54 + CHART_ROW * (int)rows);
    chart_put_title(&s, scene->input, scene->first,
                    metric == CHART_PSNR ? "Held-out PSNR against time" : "Held-out SSIM against time");
    scale(&p);
    svg_axes(&s, &p.x, &p.y, "",
             "seconds of wall clock since the program's start, evaluations left out (logarithmic)",
             metric == CHART_PSNR ? "PSNR of held-out views, dB" : "SSIM of held-out views");
    for (size_t i = 0; i < scene->count; i++) draw_band(&p, &scene->curves[metric][i]);
    for (size_t i = 0; i < scene->count; i++) draw_line(&p, &scene->curves[metric][i]);
    for (size_t i = 0; i < scene->count; i++) draw_marks(&p, &scene->curves[metric][i]);
    for (size_t i = 0; i < scene->count; i++) name_curve(&p, &scene->curves[metric][i]);
    for (size_t i = 0; i < peers_of(&p); i++) draw_peer(&p, chart_peer_of(scene->first, i), i);
    name_sizes(&p);
    svg_end(&s);
    sf_free(scene->input->ctx, p.points);
    return SF_OK;
}

/* dB below the best quality. The nearer to the best, the darker, so that the three differ without colour. */
static const struct { double below, opacity; } targets[] = {{1, 0.25}, {0.5, 0.55}, {0.1, 1}};
enum { TARGETS = sizeof targets / sizeof *targets, GROUP = TARGETS * (CHART_BAR + 3) + 26 };

static void draw_group(svg *s, const svg_axis *axis, const chart_curve *curve, double best, double y) {
    const char *color = chart_color(curve->style);
    chart_row_text(s, CHART_BAR_LEFT + 4, y + 13, curve->label);
    for (int k = 0; k < TARGETS; k++) {
        double top = y + 20 + k * (CHART_BAR + 3), seconds = chart_time_to(curve, best - targets[k].below);
        char text[64];
        snprintf(text, sizeof text, "best - %g dB", targets[k].below);
        svg_text(s, CHART_BAR_LEFT - 6, top + CHART_BAR - 3, 11, SVG_END, SVG_INK, text);
        if (seconds >= 0) {
            svg_style style = {
                .fill = color, .opacity = targets[k].opacity, .stroke = color, .width = 1, .kind = "bar"};
            svg_rect(s, CHART_BAR_LEFT, top, svg_axis_at(axis, seconds) - CHART_BAR_LEFT, CHART_BAR, &style);
            seconds_text(seconds, text, sizeof text);
        } else {
            snprintf(text, sizeof text, "not reached");
        }
        double at = seconds >= 0 ? svg_axis_at(axis, seconds) : CHART_BAR_LEFT;
        svg_text(s, at + 5, top + CHART_BAR - 3, 11, SVG_START, SVG_INK, text);
    }
}

void chart_draw_times(const chart_scene *scene, sf_writer *out) {
    svg s;
    char note[160];
    const chart_curve *curves = scene->curves[CHART_PSNR];
    double best = chart_best(scene, CHART_PSNR), most = 0, bottom = 76 + GROUP * (double)scene->count;
    for (size_t i = 0; i < scene->count; i++)
        for (int k = 0; k < TARGETS; k++)
            most = fmax(most, chart_time_to(&curves[i], best - targets[k].below));
    svg_begin(&s, out, CHART_WIDTH, (int)bottom + 46);
    chart_put_title(&s, scene->input, scene->first, "Time to a quality");
    snprintf(note, sizeof note, "best: %.2f dB, the highest mean of any curve on these held-out views", best);
    svg_text(&s, CHART_LEFT, 60, 12, SVG_START, SVG_INK, note);
    svg_axis axis = chart_bar_axis(most, 90);
    chart_draw_bar_axis(&s, &axis, 70, bottom, "seconds of wall clock since the program's start");
    for (size_t i = 0; i < scene->count; i++) draw_group(&s, &axis, &curves[i], best, 72 + GROUP * (double)i);
    svg_end(&s);
}

/* A move's seconds, and what it saved: from there to where the run before it ended. */
static void draw_move(svg *s, const svg_axis *axis, const chart_ablation *ablation, size_t i, double y) {
    const chart_move *move = &ablation->moves[i], *before = i ? move - 1 : move;
    double saved = before->seconds - move->seconds, at = svg_axis_at(axis, move->seconds), end = at;
    char text[160], seconds[32], steps[32], change[64] = "";
    svg_style solid = {.fill = chart_color(0), .stroke = chart_color(0), .width = 1, .kind = "bar"};
    svg_style gone = {.stroke = chart_color(0), .width = 1, .dashes = "3 2", .kind = "saved"};
    chart_row_text(s, CHART_LEFT + 4, y + 13, move->name);
    svg_rect(s, axis->from, y + 20, at - axis->from, CHART_BAR, &solid);
    if (saved > 0) {
        end = svg_axis_at(axis, before->seconds);
        svg_rect(s, at, y + 20, end - at, CHART_BAR, &gone);
    }
    seconds_text(move->seconds, seconds, sizeof seconds);
    chart_grouped(move->steps, steps, sizeof steps);
    if (i) snprintf(change, sizeof change, " (%+.3g)", -saved);
    snprintf(text, sizeof text, "%s%s, %s steps, %.2f dB", seconds, change, steps, move->psnr);
    svg_text(s, end + 6, y + 20 + CHART_BAR - 3, 11, SVG_START, SVG_INK, text);
}

void chart_draw_moves(const chart_ablation *ablation, sf_writer *out) {
    enum { ONE = CHART_BAR + 28 };
    svg s;
    char title[CHART_TEXT + 64];
    double most = 0, bottom = 66 + ONE * (double)ablation->count;
    for (size_t i = 0; i < ablation->count; i++) most = fmax(most, ablation->moves[i].seconds);
    svg_begin(&s, out, CHART_WIDTH, (int)bottom + 46);
    snprintf(title, sizeof title, "What each move of the schedule saves - %s", ablation->name);
    svg_text(&s, CHART_LEFT, 24, 15, SVG_START, SVG_INK, title);
    svg_text(&s, CHART_LEFT, 43, 12, SVG_START, SVG_INK,
             "each row has the moves of all rows above it too; dashed: saved against the row above");
    svg_axis axis = chart_bar_axis(most, CHART_BAR_ROOM);
    axis.from = CHART_LEFT;
    chart_draw_bar_axis(&s, &axis, 58, bottom, "seconds of wall clock");
    for (size_t i = 0; i < ablation->count; i++) draw_move(&s, &axis, ablation, i, 58 + ONE * (double)i);
    svg_end(&s);
}
