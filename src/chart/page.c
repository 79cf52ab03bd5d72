/* page.c - the page with all charts, which needs no other file, and each chart as a separate file. */
#include "chart.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

/* A chart in the page and as a file. */
typedef enum chart_kind {
    QUALITY_PSNR,
    QUALITY_SSIM,
    TIMES,
    SIZE_PSNR,
    SIZE_SSIM,
    BYTES_PSNR,
    BYTES_SSIM,
    GAP,
    DEGREES,
    MOVES,
    CHOICES,
    WALKS
} chart_kind;

static const char *const kind_names[] = {"psnr",      "ssim",       "times",      "size-psnr",
                                         "size-ssim", "bytes-psnr", "bytes-ssim", "gap",
                                         "degrees",   "moves",      "complexity", "drift"};

typedef struct page {
    const chart_input *input;
    const char *folder;
    sf_writer out;
} page;

/* What a chart shows; those that its kind does not show are NULL. */
typedef struct subject {
    const chart_scene *scene;
    const chart_sizes *sizes;
    const chart_ablation *ablation;
    const chart_choices *choices;
    const chart_input *walks;
} subject;

static sf_status draw(chart_kind kind, const subject *of, sf_writer *out) {
    switch (kind) {
    case QUALITY_PSNR:
    case QUALITY_SSIM:
        return chart_draw_quality(of->scene, kind == QUALITY_PSNR ? CHART_PSNR : CHART_SSIM, out);
    case SIZE_PSNR:
    case SIZE_SSIM:
        return chart_draw_size(of->sizes, CHART_GAUSSIANS, kind == SIZE_PSNR ? CHART_PSNR : CHART_SSIM, out);
    case BYTES_PSNR:
    case BYTES_SSIM:
        return chart_draw_size(of->sizes, CHART_BYTES, kind == BYTES_PSNR ? CHART_PSNR : CHART_SSIM, out);
    case GAP:
        return chart_draw_gap(of->sizes, out);
    case TIMES:
        chart_draw_times(of->scene, out);
        break;
    case DEGREES:
        chart_draw_degrees(of->sizes->input, of->sizes->first, out);
        break;
    case MOVES:
        chart_draw_moves(of->ablation, out);
        break;
    case CHOICES:
        chart_draw_choices(of->choices, out);
        break;
    case WALKS:
        return chart_draw_walks(of->walks, out);
    }
    return SF_OK;
}

/* "<folder>/<kind>-<name>.svg", with all that is odd in a file's name as -. */
static sf_status file_name(const page *p, chart_kind kind, const char *name, char *path, size_t size) {
    int n = snprintf(path, size, "%s/%s-", p->folder, kind_names[kind]);
    size_t need = strlen(name) + 5;
    if (n < 0 || (size_t)n + need > size)
        return sf_fail(p->input->ctx, SF_ERR_ARGUMENT, "%s: the name of the folder is too long", p->folder);
    for (size_t i = n > 0 ? (size_t)n : 0; *name; i++, name++) {
        path[i] = isalnum((unsigned char)*name) || strchr("._", *name) ? *name : '-';
        path[i + 1] = 0;
    }
    strcat(path, ".svg");
    return SF_OK;
}

static sf_status add_chart(page *p, chart_kind kind, const char *name, const subject *of) {
    char path[4096];
    sf_writer file;
    sf_status status = file_name(p, kind, name, path, sizeof path);
    if (!status) status = sf_writer_open(&file, p->input->ctx, path);
    if (status) return status;
    status = draw(kind, of, &file);
    if (status) {
        sf_writer_abandon(&file);
        return status;
    }
    status = sf_writer_commit(&file);
    if (status) return status;
    sf_writer_printf(&p->out, "<figure>\n");
    status = draw(kind, of, &p->out);
    sf_writer_printf(&p->out, "</figure>\n");
    return status;
}

static void put_base64(sf_writer *out, const uint8_t *data, size_t size) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < size; i += 3) {
        size_t left = size - i;
        uint32_t bits = (uint32_t)data[i] << 16 | (left > 1 ? (uint32_t)data[i + 1] << 8 : 0) |
                        (left > 2 ? data[i + 2] : 0);
        char four[4] = {digits[bits >> 18], digits[bits >> 12 & 63], left > 1 ? digits[bits >> 6 & 63] : '=',
                        left > 2 ? digits[bits & 63] : '='};
        sf_writer_put(out, four, 4);
    }
}

/* A strip of renders of one view, the picture itself at the end. */
static void add_snapshots(page *p, const chart_run *run) {
    if (!run->snapshot_count) return;
    sf_writer_printf(&p->out, "<h3>One held-out view over time: ");
    svg_put_text(&p->out, run->label);
    sf_writer_printf(&p->out, "</h3>\n<div class=\"strip\">\n");
    for (size_t i = 1; i <= run->snapshot_count; i++) { /* the picture comes first in the log */
        const chart_snapshot *snapshot = &run->snapshots[i % run->snapshot_count];
        char caption[96];
        if (snapshot->second)
            snprintf(caption, sizeof caption, "%.3g s: %.2f dB", snapshot->seconds, snapshot->psnr);
        else
            snprintf(caption, sizeof caption, "the picture");
        sf_writer_printf(&p->out, "<figure><img alt=\"%s\" src=\"data:image/png;base64,", caption);
        put_base64(&p->out, snapshot->png, snapshot->size);
        sf_writer_printf(&p->out, "\"/><figcaption>%s</figcaption></figure>\n", caption);
    }
    sf_writer_printf(&p->out, "</div>\n");
}

static void put_cell(page *p, const char *text) {
    sf_writer_printf(&p->out, "<td>");
    svg_put_text(&p->out, text);
    sf_writer_printf(&p->out, "</td>");
}

/* The figures of each run, for those who read no charts. */
static void add_runs(page *p, const chart_scene *scene) {
    static const char *const heads[] = {"run",         "seed",         "PSNR dB",   "SSIM",  "seconds",
                                        "set-up s",    "steps",        "Gaussians", "bytes", "needles",
                                        "evaluated s", "load average", "machine"};
    sf_writer_printf(&p->out, "<table>\n<tr>");
    for (size_t i = 0; i < sizeof heads / sizeof *heads; i++)
        sf_writer_printf(&p->out, "<th>%s</th>", heads[i]);
    sf_writer_printf(&p->out, "</tr>\n");
    for (size_t i = 0; i < p->input->run_count; i++) {
        const chart_run *run = &p->input->runs[i];
        if (!chart_same_scene(run, scene->first)) continue;
        const chart_point *end = &run->points[run->count - 1];
        char machine[3 * CHART_TEXT];
        snprintf(machine, sizeof machine, "%s, %d thread%s, %s", run->cpu, run->threads,
                 run->threads == 1 ? "" : "s", run->isa);
        sf_writer_printf(&p->out, "<tr>");
        put_cell(p, run->label);
        sf_writer_printf(&p->out,
                         "<td>%.0f</td><td>%.2f</td><td>%.4f</td><td>%.2f</td><td>%.2f</td><td>%.0f</td>"
                         "<td>%.0f</td><td>%.0f</td><td>%.2f %%</td><td>%.2f</td><td>%.1f to %.1f</td>",
                         run->seed, end->quality[CHART_PSNR], end->quality[CHART_SSIM], run->seconds,
                         run->setup_seconds, run->steps, run->gaussians, run->bytes, 100 * run->needles,
                         run->evaluation_seconds, run->load_start, run->load_end);
        put_cell(p, machine);
        sf_writer_printf(&p->out, "</tr>\n");
    }
    sf_writer_printf(&p->out, "</table>\n");
}

/* The charts of size for which the runs of a scene say enough. */
static sf_status add_sizes(page *p, const chart_run *first, const char *name) {
    chart_sizes sizes;
    sf_status status = chart_sizes_make(p->input, first, &sizes);
    if (status) return status;
    int drawn[] = {[SIZE_PSNR] = chart_sizes_known(&sizes, CHART_GAUSSIANS),
                   [BYTES_PSNR] = chart_sizes_known(&sizes, CHART_BYTES),
                   [GAP] = chart_gap_known(&sizes),
                   [DEGREES] = chart_degree_rows(p->input, first) > 0};
    drawn[SIZE_SSIM] = drawn[SIZE_PSNR], drawn[BYTES_SSIM] = drawn[BYTES_PSNR];
    for (int kind = SIZE_PSNR; kind <= DEGREES && !status; kind++)
        if (drawn[kind]) status = add_chart(p, (chart_kind)kind, name, &(subject){.sizes = &sizes});
    chart_sizes_free(&sizes);
    return status;
}

static sf_status add_scene(page *p, const chart_run *first) {
    chart_scene scene;
    sf_status status = chart_scene_make(p->input, first, &scene);
    if (status) return status;
    char name[CHART_TEXT + 32];
    snprintf(name, sizeof name, "%s-%dx%d", first->scene, first->width, first->height);
    sf_writer_printf(&p->out, "<h2>");
    svg_put_text(&p->out, first->scene);
    sf_writer_printf(&p->out, ", %d x %d</h2>\n", first->width, first->height);
    for (int kind = QUALITY_PSNR; kind <= TIMES && scene.count && !status; kind++)
        status = add_chart(p, (chart_kind)kind, name, &(subject){.scene = &scene});
    if (!status) status = add_sizes(p, first, name);
    for (size_t i = 0; i < p->input->run_count && !status; i++)
        if (chart_same_scene(&p->input->runs[i], first)) add_snapshots(p, &p->input->runs[i]);
    if (!status) add_runs(p, &scene);
    chart_scene_free(&scene);
    return status;
}

void chart_page_begin(sf_writer *out, const char *title) {
    static const char head[] = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
                               "<meta name=\"viewport\" content=\"width=device-width\"/>\n<title>splatfit: ";
    static const char style[] =
        "</title>\n<style>\n"
        ":root { color-scheme: light dark; }\n"
        "body { font: 15px/1.45 system-ui, sans-serif; max-width: 1000px; margin: 2em auto; padding: 0 1em; "
        "}\n"
        "figure { margin: 1em 0; }\n"
        "svg { max-width: 100%; height: auto; }\n"
        ".strip { display: flex; flex-wrap: wrap; gap: 10px; }\n"
        ".strip figure { margin: 0; flex: 1 1 120px; max-width: 240px; }\n"
        ".strip img { width: 100%; }\n"
        "figcaption { font-size: 13px; }\n"
        "table { margin: 1.5em 0; border-collapse: collapse; font-size: 13px; display: block; overflow-x: "
        "auto; "
        "}\n"
        "th, td { padding: 2px 8px; border-bottom: 1px solid #7d859055; text-align: right; white-space: "
        "nowrap; "
        "}\n"
        "th:first-child, td:first-child, th:last-child, td:last-child { text-align: left; }\n"
        "</style>\n</head>\n<body>\n<h1>";
    sf_writer_put(out, head, sizeof head - 1);
    svg_put_text(out, title);
    sf_writer_put(out, style, sizeof style - 1);
    svg_put_text(out, title);
    sf_writer_printf(out, "</h1>\n");
}

void chart_page_end(sf_writer *out) { sf_writer_printf(out, "</body>\n</html>\n"); }

static const char intro[] =
    "<p>Seconds are of the wall clock since the program's start, with reading pictures and set-up; what went "
    "into "
    "evaluations and snapshots on the way is taken out, and stated in the tables. PSNR and SSIM are means "
    "over "
    "the held-out views. The curve of several runs of one name is their mean where one of them was "
    "evaluated, "
    "each run interpolated over the logarithm of time and kept at its end once it is over. Needles are "
    "Gaussians "
    "whose longest axis is more than 100 times the middle one. Against size stand fits with other caps, fits "
    "that "
    "chose their number, and large fits pruned by worth and at random; the knee is the least size within 0.1 "
    "dB "
    "of the caps' best, interpolated over the logarithm of size.</p>\n";

static sf_status write_body(page *p) {
    sf_status status = SF_OK;
    chart_page_begin(&p->out, "Quality against time and size");
    sf_writer_put(&p->out, intro, sizeof intro - 1);
    for (size_t i = 0; i < p->input->run_count && !status; i++)
        if (chart_opens_scene(p->input, i)) status = add_scene(p, &p->input->runs[i]);
    if (p->input->ablation_count) sf_writer_printf(&p->out, "<h2>Moves of the schedule</h2>\n");
    for (size_t i = 0; i < p->input->ablation_count && !status; i++)
        status =
            add_chart(p, MOVES, p->input->ablations[i].name, &(subject){.ablation = &p->input->ablations[i]});
    if (p->input->choices_count) sf_writer_printf(&p->out, "<h2>Chosen size</h2>\n");
    for (size_t i = 0; i < p->input->choices_count && !status; i++)
        status =
            add_chart(p, CHOICES, p->input->choices[i].name, &(subject){.choices = &p->input->choices[i]});
    if (p->input->walk_count) sf_writer_printf(&p->out, "<h2>Walks</h2>\n");
    if (p->input->walk_count && !status)
        status = add_chart(p, WALKS, "keyframes", &(subject){.walks = p->input});
    chart_page_end(&p->out);
    return status;
}

sf_status chart_write_page(const chart_input *input, const char *folder) {
    char path[4096];
    page p = {.input = input, .folder = folder};
    int n = snprintf(path, sizeof path, "%s/index.html", folder);
    if (n < 0 || (size_t)n >= sizeof path)
        return sf_fail(input->ctx, SF_ERR_ARGUMENT, "%s: the name of the folder is too long", folder);
    sf_status status = sf_writer_open(&p.out, input->ctx, path);
    if (status) return status;
    status = write_body(&p);
    if (!status) return sf_writer_commit(&p.out);
    sf_writer_abandon(&p.out);
    return status;
}
