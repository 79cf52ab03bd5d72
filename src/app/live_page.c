/* live_page.c - what splatfit live shows in a browser. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "live.h"

#define SHOW_EVERY    0.25 /* s */
#define MODEL_EVERY   3.0
#define COVERAGE_SIDE 64.0      /* px, of the longer side */
#define SH_MOST       (3 << 20) /* bytes of a model's SH: a network that takes the .splat takes them */

int page_open(page *p, const args *a, sf_context *ctx) {
    const char *listen = args_value(a, "listen");
    sf_preview_options options = {listen, args_value(a, "token"), a->positional[0]};
    if (listen && !strcmp(listen, "none")) return 0;
    sf_status status = sf_preview_open(ctx, &options, &p->preview);
    if (status && (listen || options.token)) return app_fail(a, ctx);
    if (!args_value(a, "quiet"))
        fprintf(stderr, status ? "no page: %s\n" : "page: %s\n",
                status ? sf_last_error(ctx) : sf_preview_url(p->preview));
    return 0;
}

void page_close(page *p) {
    sf_preview_close(&p->preview);
    free(p->rgb);
    free(p->bytes);
    p->rgb = NULL, p->bytes = NULL;
}

int page_due(page *p, double seconds) {
    if (!p->preview || seconds < p->next || !sf_preview_wants(p->preview, SF_PREVIEW_STATUS)) return 0;
    p->next = seconds + SHOW_EVERY;
    return 1;
}

static int make_room(page *p, size_t pixels) {
    if (pixels <= p->capacity) return 1;
    free(p->rgb);
    free(p->bytes);
    p->rgb = malloc(3 * pixels * sizeof *p->rgb);
    p->bytes = malloc(3 * pixels);
    p->capacity = p->rgb && p->bytes ? pixels : 0;
    return p->capacity > 0;
}

static uint8_t byte(float value) { return (uint8_t)(255 * fminf(fmaxf(value, 0), 1) + 0.5f); }

static void show_camera(page *p, const sf_live_frame *f) {
    size_t pixels = (size_t)f->camera.width * (size_t)f->camera.height;
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) p->bytes[3 * i + c] = byte(f->rgb[c][i]);
    (void)sf_preview_set_picture(p->preview, SF_PREVIEW_CAMERA, f->camera.width, f->camera.height, p->bytes);
}

static void show_render(page *p, sf_live *live, const sf_live_frame *f) {
    size_t values = 3 * (size_t)f->camera.width * (size_t)f->camera.height;
    sf_image_out out = {.rgb = p->rgb};
    if (f->from == SF_POSE_NONE || sf_live_render(live, &f->camera, &out)) return;
    for (size_t i = 0; i < values; i++) p->bytes[i] = byte(p->rgb[i]);
    (void)sf_preview_set_picture(p->preview, SF_PREVIEW_RENDER, f->camera.width, f->camera.height, p->bytes);
}

static void add_frame(json_t *figures, const sf_live_frame *f) {
    static const char *const from[] = {"none", "board", "file", "track"};
    json_t *corners = json_array();
    for (size_t i = 0; i < f->corner_count; i++)
        json_array_append_new(corners, app_json_numbers(f->corners[i].pixel, 2));
    json_object_set_new(figures, "corners", corners);
    json_object_set_new(figures, "pose_from", json_string(from[f->from]));
    if (f->from == SF_POSE_NONE) return;
    json_object_set_new(figures, "pose", app_json_pose(&f->camera));
}

/* Small, and in digits: "9" where the scene is well covered, "0" where badly, "." where nobody knows. */
static json_t *coverage_values(sf_live *live, const sf_camera *camera) {
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    uint8_t *values = malloc(pixels);
    json_t *text = NULL;
    if (values && !sf_live_draw_coverage(live, camera, values)) {
        for (size_t i = 0; i < pixels; i++)
            values[i] = (uint8_t)(values[i] == SF_COVERAGE_UNKNOWN ? '.' : '0' + values[i] * 10 / 255);
        text = json_stringn((const char *)values, pixels);
    }
    free(values);
    return text;
}

static const char *worst_says(const sf_live_cell *worst) {
    if (worst->views < 3) return "hardly seen yet: go there";
    if (worst->spread < 0.1F) return "seen from one side: go around it";
    return worst->error > 0.1F ? "not clear yet: stay here" : "more views: go there";
}

static void add_coverage(json_t *figures, sf_live *live, const sf_live_frame *f) {
    sf_live_coverage c;
    sf_camera small = f->camera;
    double by = fmin(1, COVERAGE_SIDE / fmax(small.width, small.height));
    if (f->from == SF_POSE_NONE) return;
    small.width = (int32_t)fmax(1, round(small.width * by)),
    small.height = (int32_t)fmax(1, round(small.height * by));
    small.fx *= by, small.fy *= by, small.cx *= by, small.cy *= by;
    json_t *values = coverage_values(live, &small), *worst = NULL;
    sf_live_get_coverage(live, &c);
    double at[3] = {(double)c.worst.center[0], (double)c.worst.center[1], (double)c.worst.center[2]};
    if (c.has_worst) worst = app_json_numbers(at, 3);
    if (values)
        json_object_set_new(figures, "coverage",
                            json_pack("{s:i, s:i, s:o, s:o?, s:s?}", "width", (int)small.width, "height",
                                      (int)small.height, "values", values, "worst", worst, "worst_says",
                                      c.has_worst ? worst_says(&c.worst) : NULL));
}

static void show_figures(page *p, sf_live *live, json_t *figures, const sf_live_frame *f) {
    sf_live_progress progress;
    sf_live_get_progress(live, &progress);
    double origin[3];
    sf_scene_get_origin(sf_live_scene(live), origin);
    app_json_origin(figures, origin);
    if (f->number) add_frame(figures, f);
    if (f->number && sf_preview_wants(p->preview, SF_PREVIEW_COVERAGE)) add_coverage(figures, live, f);
    json_object_set_new(figures, "buttons", json_true());
    if (progress.exposure_locked >= 0)
        json_object_set_new(figures, "exposure_locked", json_boolean(progress.exposure_locked));
    json_object_set_new(figures, "memory_mb", json_real(app_peak_memory()));
    char *text = json_dumps(figures, JSON_COMPACT | JSON_REAL_PRECISION(10));
    if (text) (void)sf_preview_set_status(p->preview, text);
    free(text);
}

static void show_model(page *p, sf_live *live, double now) {
    sf_model *model = NULL;
    if (now < p->next_model || !sf_preview_wants(p->preview, SF_PREVIEW_MODEL)) return;
    p->next_model = now + MODEL_EVERY;
    if (!sf_live_snapshot(live, &model))
        (void)sf_preview_set_model(p->preview, model, sf_preview_sh_within(sf_model_count(model), SH_MOST));
    sf_model_destroy(&model);
}

/* What cannot be shown, for want of memory, is not: the fit goes on. */
void page_show(page *p, sf_live *live, json_t *figures) {
    sf_live_frame f;
    sf_live_get_frame(live, &f);
    size_t pixels = (size_t)f.camera.width * (size_t)f.camera.height;
    if (f.number && make_room(p, pixels)) {
        if (sf_preview_wants(p->preview, SF_PREVIEW_CAMERA)) show_camera(p, &f);
        if (sf_preview_wants(p->preview, SF_PREVIEW_RENDER)) show_render(p, live, &f);
    }
    if (figures) show_figures(p, live, figures, &f);
    json_decref(figures);
    show_model(p, live, p->next);
}

page_word page_command(page *p) {
    sf_preview_command given;
    if (!p->preview || !sf_preview_take_command(p->preview, &given)) return PAGE_NOTHING;
    switch (given) {
    case SF_PREVIEW_PAUSE:
        return PAGE_PAUSE;
    case SF_PREVIEW_GO_ON:
        return PAGE_GO_ON;
    case SF_PREVIEW_SAVE:
        return PAGE_SAVE;
    case SF_PREVIEW_RESET:
        return PAGE_RESET;
    case SF_PREVIEW_LOCK_EXPOSURE:
        return PAGE_LOCK;
    case SF_PREVIEW_UNLOCK_EXPOSURE:
        return PAGE_UNLOCK;
    }
    return PAGE_NOTHING;
}
