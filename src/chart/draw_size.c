/* draw_size.c - quality against size, the gap to the training views, what was chosen, SH degrees: one picture
 * each. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "parts.h"

/* Marks and dashes tell the series without colour. */
static const struct {
    size_t style;
    const char *name;
} series_of[CHART_SERIES] = {
    [CHART_CAPS] = {0, "caps: fits with other --max-gaussians"},
    [CHART_AUTO] = {3, "automatic: the fit chose its number"},
    [CHART_PRUNED] = {1, "pruned: a large fit less its least worthy Gaussians"},
    [CHART_RANDOM] = {2, "random: the same fit less any, the floor"},
};

/* How far below all other series random pruning is drawn, in parts of their range. */
#define FLOOR_SHOWN 0.5

static const char *const size_names[] = {"Gaussians of the model (logarithmic)",
                                         "bytes of the model's file (logarithmic)"};

/* A chart against size; values are `value_of`'s. */
typedef struct size_plot {
    svg *s;
    const chart_sizes *sizes;
    chart_size size;
    chart_metric metric;
    int gap; /* training less held-out PSNR in the place of the metric */
    svg_axis x, y;
    svg_point *points;
    double legend;
} size_plot;

static double value_of(const size_plot *p, const chart_size_point *at) {
    return p->gap ? at->train[CHART_PSNR] - at->quality[CHART_PSNR] : at->quality[p->metric];
}

static int is_known(const size_plot *p, const chart_size_point *at) {
    return at->size[p->size] > 0 && isfinite(value_of(p, at));
}

static void see_series(size_plot *p, int series) {
    for (size_t i = 0; i < p->sizes->count[series]; i++) {
        const chart_size_point *at = &p->sizes->points[series][i];
        if (!is_known(p, at)) continue;
        svg_axis_see(&p->x, at->size[p->size]);
        svg_axis_see(&p->y, value_of(p, at));
        if (p->gap) continue;
        svg_axis_see(&p->y, at->least[p->metric]);
        svg_axis_see(&p->y, at->most[p->metric]);
    }
}

/* Pruning at random falls far: the axis shows where it parts from the others. */
static void scale(size_plot *p) {
    p->x = (svg_axis){.from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT};
    p->y = (svg_axis){.from = CHART_TOP + CHART_PLOT, .to = CHART_TOP, .linear = 1};
    for (int s = CHART_CAPS; s < CHART_RANDOM; s++) see_series(p, s);
    svg_axis others = p->y;
    see_series(p, CHART_RANDOM);
    if (others.most > others.least)
        p->y.least = fmax(p->y.least, others.least - FLOOR_SHOWN * (others.most - others.least));
    if (p->gap) svg_axis_see(&p->y, 0);
    if (p->x.most < 4 * p->x.least) svg_axis_round(&p->x);
    p->x.least *= 0.85, p->x.most *= 1.18;
    svg_axis_round(&p->y);
}

static svg_point place(const size_plot *p, const chart_size_point *at) {
    return (svg_point){svg_axis_at(&p->x, at->size[p->size]), svg_axis_at(&p->y, value_of(p, at))};
}

static void put_note(const size_plot *p, int series, const chart_size_point *at, char *note, size_t size) {
    char gaussians[32], bytes[32];
    chart_grouped(at->size[CHART_GAUSSIANS], gaussians, sizeof gaussians);
    chart_grouped(at->size[CHART_BYTES], bytes, sizeof bytes);
    snprintf(note, size,
             p->gap || p->metric == CHART_PSNR ? "%.*s: %s Gaussians, %s bytes, %.2f dB"
                                               : "%.*s: %s Gaussians, %s bytes, SSIM %.4f",
             (int)strcspn(series_of[series].name, ":"), series_of[series].name, gaussians, bytes,
             value_of(p, at));
}

/* A line through the points, which seeds of an automatic choice do not make; whiskers from the least to the
 * most of several runs; marks. What lies below the axis is left out. */
static void draw_series(size_plot *p, int series) {
    size_t style = series_of[series].style, n = 0, shown = 0;
    svg_style line = {
        .stroke = chart_color(style), .width = 1.8, .dashes = chart_dashes(style), .kind = "curve"};
    for (size_t i = 0; i < p->sizes->count[series]; i++) {
        const chart_size_point *at = &p->sizes->points[series][i];
        if (is_known(p, at) && value_of(p, at) >= p->y.least) p->points[n++] = place(p, at);
    }
    if (n > 1 && series != CHART_AUTO) svg_polyline(p->s, p->points, n, &line);
    for (size_t i = 0; i < p->sizes->count[series]; i++) {
        char note[256];
        const chart_size_point *at = &p->sizes->points[series][i];
        if (!is_known(p, at) || value_of(p, at) < p->y.least) continue;
        svg_point where = place(p, at);
        if (at->runs > 1 && !p->gap)
            svg_line(p->s, where.x, svg_axis_at(&p->y, at->least[p->metric]), where.x,
                     svg_axis_at(&p->y, at->most[p->metric]),
                     &(svg_style){.stroke = chart_color(style), .width = 1.2});
        put_note(p, series, at, note, sizeof note);
        svg_style mark = {.fill = chart_color(style), .kind = "mark", .note = note};
        svg_mark(p->s, chart_shape(style), where.x, where.y, series == CHART_AUTO ? 6.5 : 4.5, &mark);
        shown++;
    }
    if (!shown) return;
    line.kind = NULL;
    svg_style mark = {.fill = chart_color(style)};
    chart_legend_row(p->s, &p->legend, series_of[series].name, chart_shape(style),
                     series == CHART_AUTO ? NULL : &line, &mark);
}

/* The knee of the PSNR, in each chart: an upright line, and its size in words, at its foot, where no good fit
 * is. */
static void draw_knee(size_plot *p) {
    double plateau, knee = chart_knee(p->sizes, p->size, &plateau);
    char size[32], text[192];
    if (!(knee > 0)) return;
    double x = svg_axis_at(&p->x, knee);
    chart_grouped(knee, size, sizeof size);
    svg_line(p->s, x, p->y.from, x, p->y.to, &(svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "5 4"});
    svg_text(p->s, x - 5, p->y.from - 6, 12, SVG_END, SVG_INK, size);
    snprintf(text, sizeof text, "knee: %s %s, the fewest within %g dB of the caps' best PSNR, %.2f dB", size,
             p->size == CHART_BYTES ? "bytes" : "Gaussians", CHART_KNEE, plateau);
    double y = p->legend - 4;
    svg_line(p->s, CHART_LEFT, y, CHART_LEFT + 44, y,
             &(svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "5 4"});
    chart_row_text(p->s, CHART_LEFT + 54, p->legend, text);
    p->legend += CHART_ROW;
}

static sf_status draw_plot(size_plot *p, const char *title, const char *y_name, sf_writer *out) {
    svg s;
    size_t longest = 1;
    int rows = 1;
    double plateau;
    for (int k = CHART_CAPS; k < CHART_SERIES; k++) {
        if (p->sizes->count[k] > longest) longest = p->sizes->count[k];
        rows += p->sizes->count[k] > 0;
    }
    rows += chart_knee(p->sizes, p->size, &plateau) > 0;
    p->s = &s;
    p->legend = CHART_TOP + CHART_PLOT + 62;
    p->points = sf_alloc(p->sizes->input->ctx, longest, sizeof *p->points);
    if (!p->points) return SF_ERR_MEMORY;
    svg_begin(&s, out, CHART_WIDTH, CHART_TOP + CHART_PLOT + 44 + CHART_ROW * rows);
    chart_put_title(&s, p->sizes->input, p->sizes->first, title);
    scale(p);
    svg_axes(&s, &p->x, &p->y, "", size_names[p->size], y_name);
    for (int k = CHART_SERIES - 1; k >= CHART_CAPS; k--) draw_series(p, k);
    draw_knee(p);
    svg_end(&s);
    sf_free(p->sizes->input->ctx, p->points);
    return SF_OK;
}

sf_status chart_draw_size(const chart_sizes *sizes, chart_size size, chart_metric metric, sf_writer *out) {
    size_plot p = {.sizes = sizes, .size = size, .metric = metric};
    char title[64];
    snprintf(title, sizeof title, "Held-out %s against %s", metric == CHART_PSNR ? "PSNR" : "SSIM",
             size == CHART_BYTES ? "bytes" : "the number of Gaussians");
    return draw_plot(&p, title,
                     metric == CHART_PSNR ? "PSNR of held-out views, dB" : "SSIM of held-out views", out);
}

sf_status chart_draw_gap(const chart_sizes *sizes, sf_writer *out) {
    size_plot p = {.sizes = sizes, .size = CHART_GAUSSIANS, .gap = 1};
    return draw_plot(&p, "Training less held-out PSNR against the number of Gaussians",
                     "PSNR of training less held-out views, dB", out);
}

/* Index of the choice's series among all, in their order. */
static size_t choice_style(const chart_choices *choices, size_t choice, int *opens) {
    size_t style = 0;
    for (size_t i = 0;; i++) {
        size_t before = 0;
        while (before < i && strcmp(choices->list[before].series, choices->list[i].series) != 0) before++;
        if (!strcmp(choices->list[i].series, choices->list[choice].series)) {
            *opens = i == choice;
            return style;
        }
        style += before == i;
    }
}

void chart_draw_choices(const chart_choices *choices, sf_writer *out) {
    svg s;
    int opens, rows = 2;
    char title[CHART_TEXT + 64], note[CHART_TEXT + 96], k[32], n[32];
    svg_axis x = {.from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT};
    svg_axis y = {.from = CHART_TOP + CHART_PLOT, .to = CHART_TOP};
    for (size_t i = 0; i < choices->count; i++) {
        choice_style(choices, i, &opens);
        rows += opens;
        svg_axis_see(&x, choices->list[i].complexity);
        svg_axis_see(&y, choices->list[i].gaussians);
        svg_axis_see(&y, choices->list[i].complexity);
    }
    svg_axis_round(&x);
    svg_axis_round(&y);
    double least = fmax(x.least, y.least), most = fmin(x.most, y.most);
    double legend = CHART_TOP + CHART_PLOT + 62;
    svg_begin(&s, out, CHART_WIDTH, CHART_TOP + CHART_PLOT + 44 + CHART_ROW * rows);
    snprintf(title, sizeof title, "Chosen number of Gaussians against true complexity - %s", choices->name);
    svg_text(&s, CHART_LEFT, 24, 15, SVG_START, SVG_INK, title);
    svg_axes(&s, &x, &y, "", "Gaussians that the scene was made of, k (logarithmic)",
             "Gaussians chosen, N (logarithmic)");
    svg_style line = {.stroke = SVG_INK, .width = 1.4, .dashes = "5 4", .kind = "equal"};
    svg_polyline(&s,
                 (svg_point[]){{svg_axis_at(&x, least), svg_axis_at(&y, least)},
                               {svg_axis_at(&x, most), svg_axis_at(&y, most)}},
                 2, &line);
    for (size_t i = 0; i < choices->count; i++) {
        const chart_choice *c = &choices->list[i];
        size_t style = choice_style(choices, i, &opens);
        chart_grouped(c->complexity, k, sizeof k);
        chart_grouped(c->gaussians, n, sizeof n);
        snprintf(note, sizeof note, "%s: k %s, N %s", c->series, k, n);
        svg_style mark = {.fill = chart_color(style), .kind = "mark", .note = note};
        svg_mark(&s, chart_shape(style), svg_axis_at(&x, c->complexity), svg_axis_at(&y, c->gaussians), 5,
                 &mark);
        mark.kind = mark.note = NULL;
        if (opens) chart_legend_row(&s, &legend, c->series, chart_shape(style), NULL, &mark);
    }
    svg_line(&s, CHART_LEFT, legend - 4, CHART_LEFT + 44, legend - 4,
             &(svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "5 4"});
    chart_row_text(&s, CHART_LEFT + 54, legend, "N = k");
    svg_end(&s);
}

static int has_degrees(const chart_run *run, const chart_run *first) {
    int kinds = 0;
    for (int d = 0; d < CHART_DEGREES; d++) kinds += run->degrees[d] > 0;
    return kinds > 1 && chart_same_scene(run, first);
}

size_t chart_degree_rows(const chart_input *input, const chart_run *first) {
    size_t rows = 0;
    for (size_t i = 0; i < input->run_count; i++) rows += (size_t)has_degrees(&input->runs[i], first);
    return rows;
}

/* From light to full, each in a frame: told apart without colour, and named in numbers above. */
static void draw_degree_row(svg *s, const svg_axis *axis, const chart_run *run, double y) {
    static const double opacity[CHART_DEGREES] = {0.1, 0.35, 0.65, 1};
    double sum = 0, all = 0;
    char text[CHART_TEXT + 512], numbers[CHART_DEGREES][32];
    for (int d = 0; d < CHART_DEGREES; d++) {
        all += run->degrees[d];
        chart_grouped(run->degrees[d], numbers[d], sizeof numbers[d]);
    }
    snprintf(text, sizeof text, "%s, seed %.0f: %s of degree 0, %s of 1, %s of 2, %s of 3", run->label,
             run->seed, numbers[0], numbers[1], numbers[2], numbers[3]);
    chart_row_text(s, CHART_LEFT + 4, y + 13, text);
    for (int d = 0; d < CHART_DEGREES; d++) {
        double from = svg_axis_at(axis, 100 * sum / all),
               to = svg_axis_at(axis, 100 * (sum + run->degrees[d]) / all);
        svg_style bar = {.fill = chart_color(0),
                         .opacity = opacity[d],
                         .stroke = chart_color(0),
                         .width = 1,
                         .kind = "bar"};
        if (to > from) svg_rect(s, from, y + 20, to - from, CHART_BAR, &bar);
        sum += run->degrees[d];
    }
}

void chart_draw_degrees(const chart_input *input, const chart_run *first, sf_writer *out) {
    enum { ONE = CHART_BAR + 28 };
    svg s;
    double top = 58, bottom = top + 8 + ONE * (double)chart_degree_rows(input, first), y = top;
    svg_axis axis = {
        .least = 0, .most = 100, .from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT, .linear = 1};
    svg_begin(&s, out, CHART_WIDTH, (int)bottom + 46);
    chart_put_title(&s, input, first, "Gaussians by SH degree");
    chart_draw_bar_axis(&s, &axis, top, bottom,
                        "share of the Gaussians, %: degrees 0, 1, 2 and 3 from left to right");
    for (size_t i = 0; i < input->run_count; i++) {
        if (!has_degrees(&input->runs[i], first)) continue;
        draw_degree_row(&s, &axis, &input->runs[i], y);
        y += ONE;
    }
    svg_end(&s);
}
