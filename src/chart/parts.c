/* parts.c - what the charts have in common: styles, titles, legends, bars. */
#include "parts.h"

#include <stdio.h>
#include <string.h>

/* Colours that differ in lightness too; shapes and dashes tell the same without colour. */
static const char *const colors[] = {"#0969da", "#bc4c00", "#1a7f37", "#8250df",
                                     "#bf8700", "#cf222e", "#1b7c83", "#6e7781"};
static const char *const dashes[] = {NULL, "7 3", "2 3", "9 3 2 3", "12 4", "4 2", "9 3 2 3 2 3", "1 4"};
enum { STYLES = sizeof colors / sizeof *colors };

const char *chart_color(size_t style) { return colors[style % STYLES]; }
/* Where colours begin anew, shapes step on by one and dashes by two: no two pairs are the same. */
const char *chart_dashes(size_t style) { return dashes[(style + 2 * (style / STYLES)) % STYLES]; }
svg_shape chart_shape(size_t style) { return (svg_shape)((style + style / STYLES) % SVG_SHAPES); }

void chart_grouped(double value, char *text, size_t size) {
    char digits[32];
    int n = snprintf(digits, sizeof digits, "%.0f", value), out = 0;
    for (int i = 0; i < n && out + 2 < (int)size; i++) {
        if (i && (n - i) % 3 == 0 && digits[i - 1] != '-') text[out++] = ',';
        text[out++] = digits[i];
    }
    text[out] = 0;
}

void chart_put_title(svg *s, const chart_input *input, const chart_run *first, const char *what) {
    char line[3 * CHART_TEXT];
    snprintf(line, sizeof line, "%s - %s, %dx%d", what, first->scene, first->width, first->height);
    svg_text(s, CHART_LEFT, 24, 15, SVG_START, SVG_INK, line);
    snprintf(line, sizeof line, "%s, %d thread%s", first->cpu, first->threads,
             first->threads == 1 ? "" : "s");
    for (size_t i = 0; i < input->run_count; i++) {
        const chart_run *run = &input->runs[i];
        if (!chart_same_scene(run, first)) continue;
        if (strcmp(run->cpu, first->cpu) != 0 || run->threads != first->threads)
            snprintf(line, sizeof line, "on several machines or numbers of threads");
    }
    svg_text(s, CHART_LEFT, 43, 12, SVG_START, SVG_INK, line);
}

void chart_row_text(svg *s, double x, double y, const char *text) {
    enum { LETTER = 7 /* px, of a wide one */ };
    char shown[2 * CHART_TEXT];
    size_t n = (size_t)((CHART_WIDTH - x) / LETTER);
    if (n >= strlen(text)) {
        svg_text(s, x, y, 12, SVG_START, SVG_INK, text);
        return;
    }
    n -= 2;
    while (n && ((unsigned char)text[n] & 0xc0) == 0x80) n--; /* not within a letter of UTF-8 */
    snprintf(shown, sizeof shown, "%.*s...", (int)n, text);
    svg_text(s, x, y, 12, SVG_START, SVG_INK, shown);
}

void chart_legend_row(svg *s, double *y, const char *what, svg_shape shape, const svg_style *line,
                      const svg_style *mark) {
    double middle = *y - 4;
    if (line) svg_polyline(s, (svg_point[]){{CHART_LEFT, middle}, {CHART_LEFT + 44, middle}}, 2, line);
    svg_mark(s, shape, CHART_LEFT + 22, middle, 4.5, mark);
    chart_row_text(s, CHART_LEFT + 54, *y, what);
    *y += CHART_ROW;
}

svg_axis chart_bar_axis(double most, int room) {
    svg_axis axis = {.least = 0,
                     .most = most > 0 ? most : 1,
                     .from = CHART_BAR_LEFT,
                     .to = CHART_WIDTH - room,
                     .linear = 1};
    svg_axis_round(&axis);
    return axis;
}

void chart_draw_bar_axis(svg *s, const svg_axis *axis, double top, double bottom, const char *name) {
    svg_grid(s, axis, bottom, top, 1);
    svg_line(s, axis->from, bottom, axis->to, bottom, &(svg_style){.stroke = SVG_INK, .width = 1});
    svg_line(s, axis->from, bottom, axis->from, top, &(svg_style){.stroke = SVG_INK, .width = 1});
    svg_text(s, 0.5 * (axis->from + axis->to), bottom + 34, 12, SVG_MIDDLE, SVG_INK, name);
}
