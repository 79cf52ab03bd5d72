/* record_json.c - see record_json.h. */
#include "record_json.h"

json_t *record_frame_json(const record_options *o, const sf_frame *f, double sharpness, const char *name) {
    static const char *const matrices[] = {"601", "709", "2020"};
    json_t *entry =
        json_pack("{s:s, s:I, s:I, s:i, s:i, s:f}", "file", name, "sequence", (json_int_t)f->sequence,
                  "time_ns", (json_int_t)f->time_ns, "width", (int)f->width / o->downscale, "height",
                  (int)f->height / o->downscale, "sharpness", sharpness);
    if (f->exposure_s > 0) json_object_set_new(entry, "exposure_s", json_real(f->exposure_s));
    if (f->gain > 0) json_object_set_new(entry, "gain", json_real(f->gain));
    if (o->format != RECORD_RAW || f->format == SF_PIXEL_MJPEG) return entry;
    json_object_set_new(entry, "format", json_string(sf_pixel_format_name(f->format)));
    if (f->format == SF_PIXEL_RGB24 || f->format == SF_PIXEL_BGR24) return entry;
    json_object_set_new(entry, "matrix", json_string(matrices[f->matrix]));
    json_object_set_new(entry, "range", json_string(f->full_range ? "full" : "limited"));
    return entry;
}

json_t *record_camera_json(const record_options *o, const sf_frame *f, const char *name) {
    sf_camera camera = sf_camera_downscaled(&f->camera, o->downscale);
    double center[3];
    sf_camera_center(&camera, center);
    json_t *rows = json_array();
    for (int i = 0; i < 3; i++) {
        const double *R = camera.R_cw + i; /* column i */
        json_array_append_new(rows, json_pack("[f,f,f,f]", R[0], -R[3], -R[6], center[i]));
    }
    json_array_append_new(rows, json_pack("[f,f,f,f]", 0.0, 0.0, 0.0, 1.0));
    return json_pack("{s:s, s:i, s:i, s:f, s:f, s:f, s:f, s:o}", "file_path", name, "w", (int)camera.width,
                     "h", (int)camera.height, "fl_x", camera.fx, "fl_y", camera.fy, "cx", camera.cx, "cy",
                     camera.cy, "transform_matrix", rows);
}

json_t *record_head_json(const record_options *o) {
    const sf_source_info *info = &o->info;
    json_t *head =
        json_pack("{s:s, s:o, s:o, s:s, s:i, s:i, s:f, s:b, s:i, s:b, s:i}", "version", sf_version(),
                  "source", app_json_text(o->source), "name", app_json_text(info->name), "format",
                  sf_pixel_format_name(info->format), "width", (int)info->width, "height", (int)info->height,
                  "frames_per_second", info->frames_per_second, "live", info->live, "every", o->every,
                  "sharpest", o->sharpest, "downscale", o->downscale);
    if (o->lens) json_object_set_new(head, "lens", json_deep_copy(o->lens));
    return head;
}

json_t *record_totals_json(const sf_source_counts *s, const record_counts *c) {
    json_t *totals =
        json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "given", (json_int_t)s->given, "kept",
                  (json_int_t)c->kept, "passed_over", (json_int_t)c->passed_over, "undecodable",
                  (json_int_t)c->undecodable, "dropped_by_writer", (json_int_t)c->dropped, "dropped",
                  (json_int_t)s->dropped, "skipped", (json_int_t)s->skipped, "damaged",
                  (json_int_t)s->damaged, "reopened", (json_int_t)s->reopened);
    return json_pack("{s:o}", "totals", totals);
}
