/* serve.c - shows a model on the page, with figures and a camera that move: to look at the page by hand.
 *
 * serve MODEL [LISTEN [SECONDS]]. The camera goes around, or through the views of the environment's SCENE;
 * figures and tags are made up. With the environment's SHOTS, a folder, pictures of the page on screens of
 * all kinds go there instead.
 */
#include "browser.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/clock.h"
#include "../../src/preview/preview.h"

enum { W = 640, H = 480 };

typedef struct show {
    sf_context *ctx;
    sf_preview *p;
    sf_scene *scene;
    sf_model *model;
    sf_renderer *renderer;
    double began;
    int paused, locked, moment;
} show;

static void check(const show *s, sf_status status, const char *what) {
    if (!status) return;
    fprintf(stderr, "serve: %s: %s\n", what, sf_last_error(s->ctx));
    exit(1);
}

/* A view of the scene; without one, a camera that goes around. 0: that. */
static int view_now(const show *s, sf_view_info *view) {
    sf_scene_info info = {0};
    if (s->scene) sf_scene_get_info(s->scene, &info);
    if (info.views && !sf_scene_get_view(s->scene, (size_t)s->moment % info.views, view)) return 1;
    view->camera = test_camera_around(s->moment % 64, 64, W, H);
    return 0;
}

static void set_picture(const show *s, sf_preview_part part, const sf_camera *c, const float *rgb) {
    size_t values = 3 * (size_t)c->width * (size_t)c->height;
    uint8_t *bytes = malloc(values);
    if (!bytes) return;
    for (size_t i = 0; i < values; i++) bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i], 0), 1) + 0.5f);
    check(s, sf_preview_set_picture(s->p, part, c->width, c->height, bytes), "picture");
    free(bytes);
}

/* What the camera saw, or the model from there where no scene was given. */
static void show_picture(show *s, sf_preview_part part) {
    sf_view_info view;
    int taken = view_now(s, &view);
    float *rgb = malloc(3 * sizeof *rgb * (size_t)view.camera.width * (size_t)view.camera.height);
    const sf_image_out out = {.rgb = rgb};
    if (!rgb) return;
    if (taken && part == SF_PREVIEW_CAMERA)
        check(s, sf_scene_get_pixels(s->scene, view.id, rgb, NULL), "pixels");
    else
        check(s, sf_render(s->renderer, s->model, &view.camera, NULL, &out), "render");
    set_picture(s, part, &view.camera, rgb);
    free(rgb);
}

static json_t *numbers(const double *values, int n) {
    json_t *array = json_array();
    for (int i = 0; i < n; i++) json_array_append_new(array, json_real(values[i]));
    return array;
}

/* Three tags on the picture, where there is no scene that has none. */
static json_t *corners_of(const show *s, const sf_camera *c) {
    json_t *corners = json_array();
    for (int i = 0; i < (s->scene ? 0 : 3); i++)
        for (int k = 0; k < 4; k++) {
            const double at[2] = {c->width * (0.12 + 0.1 * i + (k == 1 || k == 2 ? 0.07 : 0)),
                                  c->height * (0.72 + 0.03 * i + (k > 1 ? 0.09 : 0))};
            json_array_append_new(corners, numbers(at, 2));
        }
    return corners;
}

static void set_status(show *s, const sf_camera *c, double seconds) {
    double settled = 1 - exp(-seconds / 40);
    json_t *pose =
        json_pack("{sososfsfsfsfsisi}", "R_cw", numbers(c->R_cw, 9), "t_cw", numbers(c->t_cw, 3), "fx", c->fx,
                  "fy", c->fy, "cx", c->cx, "cy", c->cy, "width", c->width, "height", c->height);
    json_t *status = json_pack(
        "{sfsssssIsisfsfsfsisisfsfsfsbsbsosssosb}", "seconds", seconds, "state",
        s->paused ? "paused" : "fitting", "message",
        "The figures of this show are made up; the model and its pictures are not.", "gaussians",
        (json_int_t)sf_model_count(s->model), "steps", (int)(seconds * 13), "steps_per_second", 13.2,
        "frames_per_second", 29.97, "tracked_per_second", 11.4, "dropped", (int)(seconds / 7), "keyframes",
        12 + (int)(seconds / 4), "held_out_psnr", 18 + 11 * settled + 0.2 * sin(seconds), "psnr_tracked",
        19 + 11 * settled + 0.8 * sin(2.3 * seconds), "memory_mb", 184.0, "exposure_locked", s->locked,
        "throttled", seconds > 60, "pose", pose, "pose_from", s->scene ? "known" : "board", "corners",
        corners_of(s, c), "buttons", 1);
    char *text = json_dumps(status, 0);
    check(s, sf_preview_set_status(s->p, text), "status");
    free(text);
    json_decref(status);
}

static void obey(show *s) {
    sf_preview_command command;
    while (sf_preview_take_command(s->p, &command)) {
        printf("command %d\n", (int)command);
        if (command == SF_PREVIEW_PAUSE) s->paused = 1;
        if (command == SF_PREVIEW_GO_ON) s->paused = 0;
        if (command == SF_PREVIEW_LOCK_EXPOSURE) s->locked = 1;
        if (command == SF_PREVIEW_UNLOCK_EXPOSURE) s->locked = 0;
    }
}

static void advance(show *s) {
    sf_view_info view;
    view_now(s, &view);
    obey(s);
    set_status(s, &view.camera, sf_clock() - s->began);
    if (sf_preview_wants(s->p, SF_PREVIEW_CAMERA)) show_picture(s, SF_PREVIEW_CAMERA);
    if (sf_preview_wants(s->p, SF_PREVIEW_RENDER)) show_picture(s, SF_PREVIEW_RENDER);
    if (!s->paused && !getenv("SHOTS") && s->moment % 25 == 0 && sf_preview_wants(s->p, SF_PREVIEW_MODEL))
        check(s, sf_preview_set_model(s->p, s->model), "model");
    s->moment += !s->paused;
}

/* The page as it comes to rest on each screen. */
static void take_pictures(show *s, const char *folder) {
    static const struct {
        const char *name, *scheme;
        int width, height, ratio, phone;
    } screens[] = {{"desktop-dark", "dark", 1440, 900, 1, 0},
                   {"desktop-light", "light", 1440, 900, 1, 0},
                   {"laptop-light", "light", 1024, 700, 1, 0},
                   {"phone-dark", "dark", 390, 1500, 1, 1},
                   {"phone-light", "light", 320, 1500, 1, 1}};
    browser b = browser_start(1440, 900);
    for (int i = 0; i < 60; i++)
        set_status(s, &(sf_camera){.width = W, .height = H, .fx = 1, .fy = 1}, i * 1.5);
    s->began = sf_clock() - 90;
    for (size_t i = 0; i < sizeof screens / sizeof *screens; i++) {
        char path[1024];
        snprintf(path, sizeof path, "%s/%s.png", folder, screens[i].name);
        browser_scheme(&b, screens[i].scheme);
        browser_resize(&b, screens[i].width, screens[i].height, screens[i].ratio, screens[i].phone);
        browser_open(&b, sf_preview_url(s->p));
        for (int n = 0; n < 12; n++, test_pause_ms(300)) advance(s);
        browser_await(&b, "document.querySelector('#view').dataset.settled > 0");
        test_pause_ms(700);
        browser_picture(&b, NULL, path);
        printf("%s\n", path);
    }
    browser_stop(&b);
}

int main(int argc, char **argv) {
    show s = {0};
    const char *shots = getenv("SHOTS");
    if (argc < 2) {
        fprintf(stderr, "usage: serve MODEL [LISTEN [SECONDS]]\n");
        return 2;
    }
    sf_preview_options o = {.listen = argc > 2 ? argv[2] : NULL,
                            .title = getenv("SCENE") ? getenv("SCENE") : argv[1]};
    if (sf_context_create(&s.ctx, NULL)) return 1;
    check(&s, sf_model_load(s.ctx, argv[1], &s.model), "model");
    check(&s, sf_renderer_create(s.ctx, &s.renderer), "renderer");
    if (getenv("SCENE")) check(&s, sf_scene_load(s.ctx, getenv("SCENE"), NULL, &s.scene), "scene");
    check(&s, sf_preview_open(s.ctx, &o, &s.p), "preview");
    check(&s, sf_preview_set_model(s.p, s.model), "model");
    printf("%s\n", sf_preview_url(s.p));
    fflush(stdout);
    s.began = sf_clock();
    if (shots) take_pictures(&s, shots);
    while (!shots && (argc < 4 || sf_clock() - s.began < atof(argv[3]))) {
        advance(&s);
        test_pause_ms(80);
    }
    sf_preview_close(&s.p);
    sf_scene_destroy(&s.scene);
    sf_renderer_destroy(&s.renderer);
    sf_model_destroy(&s.model);
    sf_context_destroy(&s.ctx);
    return 0;
}
