/* curve.c - the curve of a label: the mean of its runs, and their spread. */
#include "chart.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/statistics.h"

/* Evaluations of two runs this near to each other in time are one sample. */
#define NEAR_IN_TIME 1.02

int chart_same_scene(const chart_run *a, const chart_run *b) {
    return !strcmp(a->scene, b->scene) && a->width == b->width && a->height == b->height;
}

int chart_opens_scene(const chart_input *input, size_t run) {
    for (size_t i = 0; i < run; i++)
        if (chart_same_scene(&input->runs[i], &input->runs[run])) return 0;
    return 1;
}

/* Between points over the logarithm of time; a run that has ended stays as it is. */
static chart_point run_at(const chart_run *run, double seconds) {
    size_t i = 0;
    while (i < run->count && run->points[i].seconds < seconds) i++;
    if (i == run->count) return run->points[i - 1];
    if (!i || run->points[i].seconds == seconds) return run->points[i];
    const chart_point *a = &run->points[i - 1], *b = &run->points[i];
    double share = log(seconds / a->seconds) / log(b->seconds / a->seconds);
    chart_point p = {.seconds = seconds, .gaussians = a->gaussians + share * (b->gaussians - a->gaussians)};
    for (int m = 0; m < CHART_METRICS; m++)
        p.quality[m] = a->quality[m] + share * (b->quality[m] - a->quality[m]);
    return p;
}

static int of_curve(const chart_scene *scene, const chart_run *run, const char *label) {
    return run->timed && chart_same_scene(run, scene->first) && !strcmp(run->label, label);
}

static chart_sample sample_at(const chart_scene *scene, const char *label, chart_metric metric,
                              double seconds) {
    const chart_input *input = scene->input;
    chart_sample s = {.seconds = seconds, .least = INFINITY, .most = -INFINITY};
    double runs = 0;
    for (size_t i = 0; i < input->run_count; i++) {
        if (!of_curve(scene, &input->runs[i], label)) continue;
        chart_point p = run_at(&input->runs[i], seconds);
        s.mean += p.quality[metric];
        s.gaussians += p.gaussians;
        s.least = fmin(s.least, p.quality[metric]);
        s.most = fmax(s.most, p.quality[metric]);
        runs++;
    }
    s.mean /= runs;
    s.gaussians /= runs;
    return s;
}

/* Of ascending times those from `first` on; of several runs, the mean of those that are near each other. */
static size_t merge_times(double *times, size_t count, double first, int several) {
    size_t kept = 0;
    for (size_t i = 0; i < count;) {
        size_t end = i + 1;
        double sum = times[i];
        while (several && end < count && times[end] <= NEAR_IN_TIME * times[i]) sum += times[end++];
        if (times[end - 1] >= first) times[kept++] = fmax(first, sum / (double)(end - i));
        i = end;
    }
    return kept;
}

static sf_status make_curve(const chart_scene *scene, const char *label, chart_metric metric,
                            chart_curve *curve) {
    const chart_input *input = scene->input;
    size_t count = 0;
    double first = 0; /* when all runs have begun */
    *curve = (chart_curve){.label = label};
    for (size_t i = 0; i < input->run_count; i++) {
        const chart_run *run = &input->runs[i];
        if (!of_curve(scene, run, label)) continue;
        count += run->count;
        first = fmax(first, run->points[0].seconds);
        curve->runs++;
    }
    double *times = sf_alloc(input->ctx, count, sizeof *times);
    curve->samples = sf_calloc(input->ctx, count, sizeof *curve->samples);
    if (times && curve->samples) {
        size_t n = 0;
        for (size_t i = 0; i < input->run_count; i++)
            for (size_t k = 0; of_curve(scene, &input->runs[i], label) && k < input->runs[i].count; k++)
                times[n++] = input->runs[i].points[k].seconds;
        qsort(times, n, sizeof *times, sf_compare_doubles);
        curve->count = merge_times(times, n, first, curve->runs > 1);
        for (size_t i = 0; i < curve->count; i++)
            curve->samples[i] = sample_at(scene, label, metric, times[i]);
    }
    sf_status status = times && curve->samples ? SF_OK : SF_ERR_MEMORY;
    sf_free(input->ctx, times);
    return status;
}

/* Whether no run before it, of its scene or of any, has its label. */
static int opens_label(const chart_input *input, size_t run, int in_scene) {
    for (size_t i = 0; i < run; i++)
        if (input->runs[i].timed && !strcmp(input->runs[i].label, input->runs[run].label) &&
            (!in_scene || chart_same_scene(&input->runs[i], &input->runs[run])))
            return 0;
    return 1;
}

/* A label is drawn alike in all scenes. */
static size_t style_of(const chart_input *input, const char *label) {
    size_t style = 0;
    for (size_t i = 0; !input->runs[i].timed || strcmp(input->runs[i].label, label) != 0; i++)
        style += (size_t)(input->runs[i].timed && opens_label(input, i, 0));
    return style;
}

sf_status chart_scene_make(const chart_input *input, const chart_run *first, chart_scene *scene) {
    *scene = (chart_scene){.input = input, .first = first};
    sf_status status = SF_OK;
    for (int m = 0; m < CHART_METRICS && !status; m++) {
        scene->curves[m] = sf_calloc(input->ctx, input->run_count, sizeof *scene->curves[m]);
        if (!scene->curves[m]) status = SF_ERR_MEMORY;
    }
    for (size_t i = 0; i < input->run_count && !status; i++) {
        if (!input->runs[i].timed || !chart_same_scene(&input->runs[i], first) || !opens_label(input, i, 1))
            continue;
        const char *label = input->runs[i].label;
        for (int m = 0; m < CHART_METRICS && !status; m++) {
            chart_curve *curve = &scene->curves[m][scene->count];
            status = make_curve(scene, label, (chart_metric)m, curve);
            curve->style = style_of(input, label);
        }
        scene->count++;
    }
    if (status) chart_scene_free(scene);
    return status;
}

void chart_scene_free(chart_scene *scene) {
    sf_context *ctx = scene->input->ctx;
    for (int m = 0; m < CHART_METRICS; m++) {
        for (size_t i = 0; scene->curves[m] && i < scene->count; i++)
            sf_free(ctx, scene->curves[m][i].samples);
        sf_free(ctx, scene->curves[m]);
        scene->curves[m] = NULL;
    }
    scene->count = 0;
}

double chart_best(const chart_scene *scene, chart_metric metric) {
    double best = -INFINITY;
    for (size_t i = 0; i < scene->count; i++)
        for (size_t k = 0; k < scene->curves[metric][i].count; k++)
            best = fmax(best, scene->curves[metric][i].samples[k].mean);
    return best;
}

double chart_time_to(const chart_curve *curve, double target) {
    for (size_t i = 0; i < curve->count; i++) {
        const chart_sample *b = &curve->samples[i], *a = b - 1;
        if (b->mean < target) continue;
        if (!i) return b->seconds;
        return a->seconds * pow(b->seconds / a->seconds, (target - a->mean) / (b->mean - a->mean));
    }
    return -1;
}
