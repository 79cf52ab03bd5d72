/* json.c - a report as JSON: numbers in the units that their names end with. */
#include "report.h"

#include <errno.h>
#include <string.h>

static json_t *machine_json(const bench_report *report) {
    const bench_machine *m = &report->machine;
    json_t *ghz = json_array(), *name = json_string(m->cpu);
    for (int i = 0; i < m->samples; i++) json_array_append_new(ghz, json_real(m->ghz[i]));
    return json_pack("{s:o, s:i, s:i, s:f, s:f, s:f, s:f, s:f, s:o, s:s, s:b}", "cpu",
                     name ? name : json_string("?"), "cpus", m->cpus, "threads", m->threads, "load_start",
                     m->load_start, "load_end", m->load_end, "last_cache_bytes", m->last_cache,
                     "memory_available_bytes", m->memory, "clock_ghz", bench_kernel_ghz(report),
                     "clock_samples_ghz", ghz, "version", sf_version(), "quick", report->quick);
}

static json_t *pair_json(const double pair[2]) { return json_pack("[f, f]", pair[0], pair[1]); }

/* Pairs are of one thread and of all. */
static json_t *roofs_json(const bench_report *report) {
    const bench_bandwidth *b = &report->bandwidth;
    json_t *levels = json_object();
    for (int i = 0; i < report->levels; i++)
        json_object_set_new(levels, report->level[i].name, pair_json(report->level[i].gflops));
    return json_pack("{s:o, s:f, s:o, s:o, s:o}", "multiply_add_gflops", levels, "memory_array_bytes",
                     b->bytes, "memory_read_gbs", pair_json(b->read), "memory_write_gbs", pair_json(b->write),
                     "memory_update_gbs", pair_json(b->update));
}

static json_t *scene_json(const bench_load *load) {
    return json_pack("{s:I, s:i, s:i, s:f, s:f, s:f}", "gaussians", (json_int_t)load->gaussians, "width",
                     load->width, "height", load->height, "entries", load->entries, "contributing_pairs",
                     load->contributing, "evaluated_pairs_4x4", load->evaluated_4x4);
}

static json_t *kernel_json(const bench_report *report, int level, int row) {
    const bench_kernel *k = &report->kernel[level][row], *scalar = &report->kernel[0][row];
    double ns = 1e9 * k->seconds / k->units;
    json_t *o = json_pack("{s:s, s:s, s:s, s:f, s:f, s:f}", "kernel", k->name, "level",
                          report->level[level].name, "unit", k->unit, "units", k->units, "ns_per_unit", ns,
                          "cycles_per_unit", ns * bench_kernel_ghz(report));
    double share = bench_roof_share(report, level, k);
    if (scalar->seconds > 0)
        json_object_set_new(o, "ratio_to_scalar", json_real(scalar->seconds / k->seconds));
    if (k->operations > 0) json_object_set_new(o, "operations_per_unit", json_real(k->operations / k->units));
    if (k->bytes > 0) json_object_set_new(o, "bytes_per_unit", json_real(k->bytes / k->units));
    if (share > 0) json_object_set_new(o, "share_of_roof", json_real(share));
    if (k->instructions > 0) json_object_set_new(o, "instructions_per_unit", json_real(k->instructions));
    return o;
}

static json_t *kernels_json(const bench_report *report) {
    json_t *list = json_array();
    for (int row = 0; row < report->kernels; row++)
        for (int level = 0; level < report->levels; level++)
            if (report->kernel[level][row].seconds > 0)
                json_array_append_new(list, kernel_json(report, level, row));
    return list;
}

static json_t *step_json(const bench_report *report, const bench_step_times *step) {
    json_t *stages = json_object(), *floors = json_object();
    for (int k = 0; k < STAGES; k++) {
        double floor = bench_floor(report, step, k);
        json_object_set_new(stages, bench_stage_names[k], json_real(1e3 * step->seconds[k]));
        int counted = step->evaluated > 0 && floor > 0;
        if (counted) json_object_set_new(floors, bench_stage_names[k], json_real(1e3 * floor));
    }
    json_t *o =
        json_pack("{s:s, s:i, s:I, s:i, s:i, s:i, s:o, s:o}", "level", report->level[step->level].name,
                  "threads", step->threads, "gaussians", (json_int_t)step->gaussians, "width", step->width,
                  "height", step->height, "rounds", step->rounds, "ms", stages, "roof_ms", floors);
    if (step->entries > 0) json_object_set_new(o, "entries", json_real(step->entries));
    if (step->evaluated > 0) { /* counted */
        json_object_set_new(o, "contributing_pairs", json_real(step->contributing));
        json_object_set_new(o, "evaluated_pairs", json_real(step->evaluated));
    }
    return o;
}

static json_t *steps_json(const bench_report *report, const bench_step_times *steps, int n) {
    json_t *list = json_array();
    for (int i = 0; i < n; i++) json_array_append_new(list, step_json(report, &steps[i]));
    return list;
}

static json_t *far_json(const bench_report *report) {
    json_t *o = step_json(report, &report->far);
    json_object_set_new(o, "update_gbs", json_real(bench_far_gbs(report)));
    return o;
}

static json_t *accuracy_json(const bench_report *report) {
    json_t *list = json_array();
    for (int i = 0; i < report->accuracies; i++) {
        const bench_accuracy *a = &report->accuracy[i];
        json_array_append_new(
            list,
            json_pack("{s:s, s:i, s:f, s:f, s:f, s:f, s:f, s:f}", "level", report->level[a->level].name,
                      "degree", a->degree, "ns_per_pair", 1e9 * a->seconds / a->pairs, "backward_ns_per_pair",
                      1e9 * a->seconds_bwd / a->pairs, "picture_rms", a->picture_rms, "picture_max",
                      a->picture_max, "gradient_rms", a->gradient_rms, "gradient_max", a->gradient_max));
    }
    return list;
}

static json_t *fitted_json(const bench_report *report) {
    const bench_fitted *f = &report->fitted;
    json_t *list = json_array();
    for (int i = 0; i < f->count; i++) {
        json_t *step = step_json(report, &f->times[i]);
        json_object_set_new(step, "median_total_ms", json_real(1e3 * f->times[i].median_total));
        json_array_append_new(list, step);
    }
    return json_pack("{s:I, s:I, s:i, s:i, s:o}", "gaussians", (json_int_t)f->gaussians, "views",
                     (json_int_t)f->views, "width", f->width, "height", f->height, "steps", list);
}

static json_t *photos_json(const bench_report *report) {
    json_t *list = json_array();
    for (int i = 0; i < report->photo_rows; i++) {
        const bench_photos *p = &report->photos[i];
        json_array_append_new(list, json_pack("{s:s, s:s, s:i, s:i, s:f, s:f, s:f, s:f}", "level",
                                              report->level[p->level].name, "scale_space_begins", p->start,
                                              "width", p->width, "height", p->height, "features", p->features,
                                              "features_ms", 1e3 * p->features_seconds, "matches", p->matches,
                                              "match_ms", 1e3 * p->match_seconds));
    }
    return list;
}

json_t *bench_json(const bench_report *report) {
    json_t *o = json_pack("{s:o, s:o, s:o, s:o}", "machine", machine_json(report), "kernels",
                          kernels_json(report), "steps", steps_json(report, report->step, report->steps),
                          "accuracy", accuracy_json(report));
    if (o && report->bandwidth.bytes > 0) json_object_set_new(o, "roofs", roofs_json(report));
    if (o && report->load.gaussians) json_object_set_new(o, "scene", scene_json(&report->load));
    if (o && report->stages) {
        json_object_set_new(o, "stages", steps_json(report, report->stage, report->stages));
        json_object_set_new(o, "update_beyond_caches", far_json(report));
    }
    if (o && report->photo_rows) json_object_set_new(o, "sfm", photos_json(report));
    if (o && report->fitted.count) json_object_set_new(o, "model", fitted_json(report));
    return o;
}

static int level_of(const bench_report *report, const char *name) {
    int l = 0;
    while (l < report->levels && strcmp(report->level[l].name, name) != 0) l++;
    return l;
}

static void take_before(bench_report *report, json_t *item) {
    enum { MOST = sizeof report->before / sizeof *report->before };
    const char *level;
    bench_accuracy a = {0};
    double ns, backward_ns;
    if (report->befores == MOST ||
        json_unpack(item, "{s:s, s:i, s:F, s:F, s:F, s:F}", "level", &level, "degree", &a.degree,
                    "ns_per_pair", &ns, "backward_ns_per_pair", &backward_ns, "picture_rms", &a.picture_rms,
                    "gradient_rms", &a.gradient_rms))
        return;
    a.level = level_of(report, level);
    a.seconds = 1e-9 * ns, a.seconds_bwd = 1e-9 * backward_ns, a.pairs = 1;
    if (a.level < report->levels && ns > 0 && backward_ns > 0 && a.picture_rms > 0 && a.gradient_rms > 0)
        report->before[report->befores++] = a;
}

sf_status bench_read_before(sf_context *ctx, const char *path, bench_report *report) {
    json_error_t error;
    json_t *root = json_load_file(path, 0, &error);
    if (!root && error.line < 0)
        return sf_fail(ctx, SF_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
    if (!root) return sf_fail(ctx, SF_ERR_FORMAT, "%s: line %d: %s", path, error.line, error.text);
    json_t *list = json_object_get(root, "accuracy");
    for (size_t i = 0; i < json_array_size(list); i++) take_before(report, json_array_get(list, i));
    json_decref(root);
    if (report->befores) return SF_OK;
    return sf_fail(ctx, SF_ERR_FORMAT,
                   "%s: accuracy: no figures of a level here: splatfit bench --json writes them", path);
}
