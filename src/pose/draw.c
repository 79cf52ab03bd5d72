/* draw.c - sketches as SVG, PDF and PNG, each at its true size. */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <spng.h>

#include "../sim/lettering.h"
#include "board.h"

/* The sketch. */

sf_status sf_sketch_bar(sf_sketch *s, double x, double y, double width, double height) {
    sf_status status =
        sf_grow(s->ctx, &s->bars, &s->bar_capacity, s->bar_count, s->bar_count + 1, sizeof *s->bars);
    if (!status) s->bars[s->bar_count++] = (sf_bar){x, y, width, height};
    return status;
}

static sf_status add_stroke(sf_sketch *s, sf_stroke stroke) {
    sf_status status = sf_grow(s->ctx, &s->strokes, &s->stroke_capacity, s->stroke_count, s->stroke_count + 1,
                               sizeof *s->strokes);
    if (!status) s->strokes[s->stroke_count++] = stroke;
    return status;
}

static sf_status add_letter(sf_sketch *s, char letter, double x, double y, double unit) {
    sf_status status = SF_OK;
    const char *p = sf_letter_strokes((char)toupper((unsigned char)letter));
    for (; *p && p[2] && !status; p += p[2] == ' ' ? 3 : 2)
        if (p[2] != ' ')
            status = add_stroke(s, (sf_stroke){x + (p[0] - '0') * unit, y - (p[1] - '0') * unit,
                                               x + (p[2] - '0') * unit, y - (p[3] - '0') * unit, 0.8 * unit});
    return status;
}

sf_status sf_sketch_text(sf_sketch *s, const char *text, double x, double y, double height) {
    double unit = height / SF_LETTER_HEIGHT;
    sf_status status = SF_OK;
    for (size_t i = 0; text[i] && !status; i++)
        status = add_letter(s, text[i], x + (double)(i * SF_LETTER_PITCH) * unit, y, unit);
    return status;
}

void sf_sketch_free(sf_sketch *s) {
    sf_free(s->ctx, s->bars);
    sf_free(s->ctx, s->strokes);
}

/* Text that grows, for a stream whose length comes before it. */
typedef struct growing {
    sf_context *ctx;
    char *data;
    size_t size, capacity;
    sf_status status;
} growing;

static void put(growing *g, const char *text) {
    size_t n = strlen(text);
    if (!g->status) g->status = sf_grow(g->ctx, &g->data, &g->capacity, g->size, g->size + n, 1);
    if (g->status) return;
    memcpy(g->data + g->size, text, n);
    g->size += n;
}

/* A number with 4 decimals and what follows it: with a point in every locale. */
static void put_number(growing *g, double value, const char *after) {
    char text[40];
    long long scaled = llround(fabs(value) * 1e4);
    snprintf(text, sizeof text, "%s%lld.%04lld%s", value < 0 && scaled ? "-" : "", scaled / 10000,
             scaled % 10000, after);
    put(g, text);
}

static sf_status finish(growing *g, const char *path) {
    sf_status status = g->status ? g->status : sf_write_file(g->ctx, path, g->data, g->size);
    sf_free(g->ctx, g->data);
    return status;
}

/* SVG. */

static void svg_bars(growing *g, const sf_sketch *s) {
    put(g, "<path d=\"");
    for (size_t i = 0; i < s->bar_count; i++) {
        const sf_bar *b = &s->bars[i];
        put(g, i ? "\nM" : "M");
        put_number(g, b->x, " ");
        put_number(g, b->y, "h");
        put_number(g, b->width, "v");
        put_number(g, b->height, "h");
        put_number(g, -b->width, "z");
    }
    put(g, "\"/>\n");
}

static void svg_strokes(growing *g, const sf_sketch *s) {
    put(g, "<g stroke=\"#000\" stroke-linecap=\"round\">\n");
    for (size_t i = 0; i < s->stroke_count; i++) {
        const sf_stroke *k = &s->strokes[i];
        put(g, "<path stroke-width=\"");
        put_number(g, k->width, "\" d=\"M");
        put_number(g, k->x0, " ");
        put_number(g, k->y0, "L");
        put_number(g, k->x1, " ");
        put_number(g, k->y1, "\"/>\n");
    }
    put(g, "</g>\n");
}

sf_status sf_sketch_svg(const sf_sketch *s, const char *path) {
    growing g = {.ctx = s->ctx};
    put(&g, "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"");
    put_number(&g, s->width, "mm\" height=\"");
    put_number(&g, s->height, "mm\" viewBox=\"0 0 ");
    put_number(&g, s->width, " ");
    put_number(&g, s->height, "\">\n<title>");
    put(&g, s->title);
    put(&g, "</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n");
    svg_bars(&g, s);
    svg_strokes(&g, s);
    put(&g, "</svg>\n");
    return finish(&g, path);
}

/* PDF: one page, as PDF 1.4 has it. */

static const double POINTS = 72 / 25.4; /* in a mm */

static void pdf_bars(growing *g, const sf_sketch *s) {
    for (size_t i = 0; i < s->bar_count; i++) {
        const sf_bar *b = &s->bars[i];
        put_number(g, b->x * POINTS, " ");
        put_number(g, (s->height - b->y - b->height) * POINTS, " ");
        put_number(g, b->width * POINTS, " ");
        put_number(g, b->height * POINTS, " re\n");
    }
    put(g, "f\n1 J\n"); /* fills; round ends */
}

static void pdf_strokes(growing *g, const sf_sketch *s) {
    for (size_t i = 0; i < s->stroke_count; i++) {
        const sf_stroke *k = &s->strokes[i];
        put_number(g, k->width * POINTS, " w ");
        put_number(g, k->x0 * POINTS, " ");
        put_number(g, (s->height - k->y0) * POINTS, " m ");
        put_number(g, k->x1 * POINTS, " ");
        put_number(g, (s->height - k->y1) * POINTS, " l S\n");
    }
}

enum { PDF_OBJECTS = 5 };

static void pdf_objects(growing *g, const sf_sketch *s, const growing *content, size_t at[PDF_OBJECTS]) {
    char text[64];
    at[0] = g->size;
    put(g, "1 0 obj\n<< /Type /Catalog /Pages 2 0 R >>\nendobj\n");
    at[1] = g->size;
    put(g, "2 0 obj\n<< /Type /Pages /Kids [3 0 R] /Count 1 >>\nendobj\n");
    at[2] = g->size;
    put(g, "3 0 obj\n<< /Type /Page /Parent 2 0 R /Resources << >> /Contents 4 0 R /MediaBox [0 0 ");
    put_number(g, s->width * POINTS, " ");
    put_number(g, s->height * POINTS, "] >>\nendobj\n");
    at[3] = g->size;
    snprintf(text, sizeof text, "4 0 obj\n<< /Length %zu >>\nstream\n", content->size);
    put(g, text);
    put(g, content->data ? content->data : "");
    put(g, "\nendstream\nendobj\n");
    at[4] = g->size;
    put(g, "5 0 obj\n<< /Title (");
    put(g, s->title);
    put(g, ") /Producer (splatfit) >>\nendobj\n");
}

sf_status sf_sketch_pdf(const sf_sketch *s, const char *path) {
    growing content = {.ctx = s->ctx}, g = {.ctx = s->ctx};
    size_t at[PDF_OBJECTS];
    char text[96];
    pdf_bars(&content, s);
    pdf_strokes(&content, s);
    if (!content.status)
        content.status = sf_grow(s->ctx, &content.data, &content.capacity, content.size, content.size + 1, 1);
    if (content.status) {
        sf_free(s->ctx, content.data);
        return content.status;
    }
    content.data[content.size] = 0;
    put(&g, "%PDF-1.4\n");
    pdf_objects(&g, s, &content, at);
    sf_free(s->ctx, content.data);
    size_t table = g.size;
    snprintf(text, sizeof text, "xref\n0 %d\n0000000000 65535 f \n", PDF_OBJECTS + 1);
    put(&g, text);
    for (int i = 0; i < PDF_OBJECTS; i++) {
        snprintf(text, sizeof text, "%010zu 00000 n \n", at[i]);
        put(&g, text);
    }
    snprintf(text, sizeof text, "trailer\n<< /Size %d /Root 1 0 R /Info 5 0 R >>\nstartxref\n%zu\n%%%%EOF\n",
             PDF_OBJECTS + 1, table);
    put(&g, text);
    return finish(&g, path);
}

/* PNG. */

static const double DOTS = 300 / 25.4; /* in a mm */

typedef struct raster {
    int width, height; /* dots */
    uint8_t *ink;      /* 0: white, 255: black */
} raster;

/* What part of dot i lies in [from, to). */
static double covered(int i, double from, double to) { return fmax(fmin(i + 1, to) - fmax(i, from), 0); }

/* Bars overlap and share edges: the darkest counts. */
static void ink_dot(raster *r, int x, int y, double part) {
    uint8_t *dot = &r->ink[(size_t)y * (size_t)r->width + (size_t)x], ink = (uint8_t)(255 * part + 0.5);
    if (ink > *dot) *dot = ink;
}

static int within(double value, int most) { return value < 0 ? 0 : value > most ? most : (int)value; }

static void ink_bar(raster *r, const sf_bar *b) {
    double x0 = b->x * DOTS, y0 = b->y * DOTS, x1 = x0 + b->width * DOTS, y1 = y0 + b->height * DOTS;
    int right = within(ceil(x1), r->width), bottom = within(ceil(y1), r->height);
    for (int y = within(y0, r->height); y < bottom; y++)
        for (int x = within(x0, r->width); x < right; x++)
            ink_dot(r, x, y, covered(x, x0, x1) * covered(y, y0, y1));
}

static double segment_distance(const sf_stroke *k, double x, double y) {
    double ax = k->x1 - k->x0, ay = k->y1 - k->y0, length2 = ax * ax + ay * ay;
    double t = length2 > 0 ? ((x - k->x0) * ax + (y - k->y0) * ay) / length2 : 0;
    t = fmin(fmax(t, 0), 1);
    return hypot(x - k->x0 - t * ax, y - k->y0 - t * ay);
}

static void ink_stroke(raster *r, const sf_stroke *k) {
    double reach = k->width / 2 + 1 / DOTS;
    int left = within((fmin(k->x0, k->x1) - reach) * DOTS, r->width);
    int right = within((fmax(k->x0, k->x1) + reach) * DOTS + 1, r->width);
    int top = within((fmin(k->y0, k->y1) - reach) * DOTS, r->height);
    int bottom = within((fmax(k->y0, k->y1) + reach) * DOTS + 1, r->height);
    for (int y = top; y < bottom; y++)
        for (int x = left; x < right; x++) {
            double inside = k->width / 2 - segment_distance(k, (x + 0.5) / DOTS, (y + 0.5) / DOTS);
            ink_dot(r, x, y, fmin(fmax(inside * DOTS + 0.5, 0), 1));
        }
}

static sf_status encode(sf_context *ctx, const raster *r, const char *path) {
    struct spng_ihdr header = {.width = (uint32_t)r->width,
                               .height = (uint32_t)r->height,
                               .bit_depth = 8,
                               .color_type = SPNG_COLOR_TYPE_GRAYSCALE};
    struct spng_phys dots = {.ppu_x = 11811, .ppu_y = 11811, .unit_specifier = 1}; /* 300 an inch, per m */
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    if (!png) return sf_fail(ctx, SF_ERR_MEMORY, "%s: out of memory", path);
    size_t size = (size_t)r->width * (size_t)r->height;
    int error = spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1);
    if (!error) error = spng_set_ihdr(png, &header);
    if (!error) error = spng_set_phys(png, &dots);
    if (!error) error = spng_encode_image(png, r->ink, size, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE);
    void *file = error ? NULL : spng_get_png_buffer(png, &size, &error);
    sf_status status = file ? sf_write_file(ctx, path, file, size)
                            : sf_fail(ctx, SF_ERR_MEMORY, "%s: PNG: %s", path, spng_strerror(error));
    free(file);
    spng_ctx_free(png);
    return status;
}

sf_status sf_sketch_png(const sf_sketch *s, const char *path) {
    raster r = {.width = (int)lround(s->width * DOTS), .height = (int)lround(s->height * DOTS)};
    size_t dots = (size_t)r.width * (size_t)r.height;
    r.ink = sf_calloc(s->ctx, dots, 1);
    if (!r.ink) return SF_ERR_MEMORY;
    for (size_t i = 0; i < s->bar_count; i++) ink_bar(&r, &s->bars[i]);
    for (size_t i = 0; i < s->stroke_count; i++) ink_stroke(&r, &s->strokes[i]);
    for (size_t i = 0; i < dots; i++) r.ink[i] = (uint8_t)(255 - r.ink[i]);
    sf_status status = encode(s->ctx, &r, path);
    sf_free(s->ctx, r.ink);
    return status;
}
