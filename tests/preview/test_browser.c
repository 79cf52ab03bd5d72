/* test_browser.c - the page in a real browser: what it draws is what the library renders, its figures move,
 * its buttons work, it comes back by itself. */
#include "browser.h"
#include "../program.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/rng.h"
#include "../../src/io/picture.h"
#include "../../src/preview/preview.h"

enum { WIDTH = 1000, HEIGHT = 900, BLOBS = 400, SHOT_W = 160, SHOT_H = 120 };

typedef struct fixture {
    sf_context *ctx;
    sf_preview *p;
} fixture;

/* One for all tests: it takes seconds to start. */
static browser shared;

static const char token[] = "token-of-the-test";

static void open_preview(fixture *f, const char *listen, const char *with) {
    sf_preview_options o = {.listen = listen, .token = with, .title = "blobs"};
    sf_status status = sf_preview_open(f->ctx, &o, &f->p);
    if (status == SF_ERR_UNSUPPORTED) {
        sf_context_destroy(&f->ctx);
        test_skip("not built with civetweb");
    }
    assert_ok(f->ctx, status);
}

static fixture start(void) {
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK: a browser is slow there");
    if (!shared.pid) shared = browser_start(WIDTH, HEIGHT); /* skips where there is none */
    fixture f = {.ctx = test_context()};
    open_preview(&f, "127.0.0.1:0", token);
    shared.exceptions = 0;
    browser_open(&shared, "about:blank");
    browser_resize(&shared, WIDTH, HEIGHT, 1, 0);
    return f;
}

static void end(fixture *f) {
    assert_int_equal(shared.exceptions, 0);
    sf_preview_close(&f->p);
    sf_context_destroy(&f->ctx);
}

/* Blobs of all shapes and colours about the origin, as a .splat has them. */
static sf_model *make_blobs(sf_context *ctx) {
    sf_model *model, *stored;
    sf_rng rng;
    sf_rng_seed(&rng, 7);
    assert_ok(ctx, sf_model_create(ctx, BLOBS, 0, &model));
    for (size_t i = 0; i < BLOBS; i++) {
        float mean[3], quat[4], scale[3], sh[3], logit = (float)(3 * sf_rng_normal(&rng));
        for (int k = 0; k < 3; k++) mean[k] = (float)(0.6 * sf_rng_normal(&rng));
        for (int k = 0; k < 4; k++) quat[k] = (float)sf_rng_normal(&rng);
        for (int k = 0; k < 3; k++) scale[k] = (float)(-2.6 + 0.7 * sf_rng_normal(&rng));
        for (int k = 0; k < 3; k++) sh[k] = (float)(3.4 * sf_rng_uniform(&rng) - 1.7);
        sf_gaussians g = {mean, quat, scale, &logit, sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &g));
    }
    assert_ok(ctx, sf_model_save(model, test_path("blobs.splat")));
    assert_ok(ctx, sf_model_load(ctx, test_path("blobs.splat"), &stored));
    sf_model_set_antialiased(stored, sf_model_antialiased(model));
    sf_model_destroy(&model);
    return stored;
}

/* The same places, with colours that are others from everywhere: some beyond what a byte of a .splat holds.
 */
static sf_model *make_shaded(sf_context *ctx, int sh_degree) {
    sf_model *plain = make_blobs(ctx), *model;
    size_t values = 3 * (size_t)((sh_degree + 1) * (sh_degree + 1));
    sf_rng rng;
    sf_rng_seed(&rng, 8);
    assert_ok(ctx, sf_model_create(ctx, BLOBS, sh_degree, &model));
    for (size_t i = 0; i < BLOBS; i++) {
        float mean[3], quat[4], scale[3], logit, sh[48];
        const sf_gaussians g = {mean, quat, scale, &logit, sh};
        assert_ok(ctx, sf_model_get(plain, i, 1, &g));
        for (size_t k = 0; k < 3; k++) sh[k] *= 1.2f;
        for (size_t k = 3; k < values; k++) sh[k] = (float)(0.25 * sf_rng_normal(&rng));
        assert_ok(ctx, sf_model_set(model, i, 1, &g));
    }
    sf_model_destroy(&plain);
    return model;
}

static void set_status(fixture *f, const char *json) { assert_ok(f->ctx, sf_preview_set_status(f->p, json)); }

/* ---- The model ---- */

/* PSNR of the page's canvas against the library's picture of the same camera. */
static double likeness(fixture *f, const sf_model *model, sf_camera camera) {
    sf_renderer *renderer;
    sf_quality quality;
    int w = camera.width, h = camera.height;
    float *wanted = malloc(3 * sizeof *wanted * (size_t)w * (size_t)h),
          *got = browser_pixels(&shared, f->ctx, "#view", w, h);
    assert_non_null(wanted);
    assert_ok(f->ctx, sf_renderer_create(f->ctx, &renderer));
    const sf_image_out out = {.rgb = wanted};
    assert_ok(f->ctx, sf_render(renderer, model, &camera, NULL, &out));
    assert_ok(f->ctx, sf_compare(renderer, w, h, got, wanted, NULL, &quality));
    sf_renderer_destroy(&renderer);
    free(wanted);
    free(got);
    return quality.psnr;
}

/* The page's address with the view of a camera in it: of a picture of the aspect 1. */
static const char *address_of(const char *page, const sf_camera *c, double focal) {
    static char url[1024];
    int used = snprintf(url, sizeof url, "%s#view=", page);
    for (int i = 0; i < 9; i++) used += snprintf(url + used, sizeof url - (size_t)used, "%.9g,", c->R_cw[i]);
    for (int i = 0; i < 3; i++) used += snprintf(url + used, sizeof url - (size_t)used, "%.9g,", c->t_cw[i]);
    snprintf(url + used, sizeof url - (size_t)used, "%.9g,1,0,0", focal);
    return url;
}

static const char settled[] = "document.querySelector('#view').dataset.settled > 0";

static void await_drawing(void) {
    browser_await(&shared, settled);
    test_pause_ms(300);
    browser_await(&shared, settled);
}

/* The canvas' size, of an address with such a focal length. */
static void fit_to_canvas(sf_camera *camera, double focal) {
    camera->width = (int)browser_number(&shared, "document.querySelector('#view').clientWidth");
    camera->height = (int)browser_number(&shared, "document.querySelector('#view').clientHeight");
    camera->fx = camera->fy = focal * (camera->width < camera->height ? camera->width : camera->height);
    camera->cx = camera->width / 2.0;
    camera->cy = camera->height / 2.0;
}

static void test_model_is_drawn(void **state) {
    fixture f = start();
    (void)state;
    sf_model *model = make_blobs(f.ctx);
    for (int antialiased = 0; antialiased < 2; antialiased++) {
        sf_camera camera = test_camera_around(antialiased * 3 + 1, 8, 100, 100);
        sf_model_set_antialiased(model, antialiased);
        assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
        browser_open(&shared, "about:blank");
        browser_open(&shared, address_of(sf_preview_url(f.p), &camera, 0.9));
        await_drawing();
        fit_to_canvas(&camera, 0.9);
        double psnr = likeness(&f, model, camera);
        print_message("%d x %d, antialiased %d: %.1f dB\n", camera.width, camera.height, antialiased, psnr);
        assert_true(psnr > 35);
        /* It would notice: another camera is another picture. */
        camera.t_cw[0] += 0.02;
        assert_true(likeness(&f, model, camera) < psnr - 3);
    }
    assert_string_equal(browser_text(&shared, "document.querySelector('#model-facts').textContent"),
                        "400 Gaussians");
    /* The token is not left in the address. */
    assert_null(strstr(browser_text(&shared, "location.href"), token));
    sf_model_destroy(&model);
    end(&f);
}

static void await_degree(int degree) {
    char text[128];
    snprintf(text, sizeof text, "document.querySelector('#model-facts').textContent.endsWith('degree %d')",
             degree);
    browser_await(&shared, text);
}

/* Colours that depend on the direction, from two sides and in part. */
static void test_harmonics_are_drawn(void **state) {
    fixture f = start();
    (void)state;
    for (int degree = SF_MAX_SH_DEGREE; degree > 0; degree--) {
        sf_model *model = make_shaded(f.ctx, degree);
        assert_ok(f.ctx, sf_preview_set_model(f.p, model, SF_MAX_SH_DEGREE));
        for (int side = 1; side < 7; side += 3) {
            sf_camera camera = test_camera_around(side, 8, 100, 100);
            browser_open(&shared, "about:blank");
            browser_open(&shared, address_of(sf_preview_url(f.p), &camera, 0.9));
            await_degree(degree);
            await_drawing();
            fit_to_canvas(&camera, 0.9);
            double psnr = likeness(&f, model, camera);
            print_message("degree %d, side %d: %.1f dB\n", degree, side, psnr);
            assert_true(psnr > 35);
        }
        sf_model_destroy(&model);
    }
    /* Fewer bands are another picture; then none. */
    sf_model *model = make_shaded(f.ctx, 3);
    sf_camera camera = test_camera_around(4, 8, 100, 100);
    fit_to_canvas(&camera, 0.9);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 1));
    browser_await(&shared, "newest.model == 4");
    await_degree(1);
    await_drawing();
    assert_true(likeness(&f, model, camera) < 30);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 0));
    browser_await(&shared, "document.querySelector('#model-facts').textContent == '400 Gaussians'");
    await_drawing();
    assert_true(likeness(&f, model, camera) < 30);
    sf_model_destroy(&model);
    end(&f);
}

/* ---- A finished model, shown by the program ---- */

/* Two cameras of the ring as cameras.json. */
static void write_cameras(void) {
    char text[4096] = "[";
    for (int i = 0; i < 2; i++) {
        sf_camera c = test_camera_around(3 * i, 8, 100, 100);
        const double *R = c.R_cw;
        double at[3];
        size_t used = strlen(text);
        sf_camera_center(&c, at);
        snprintf(text + used, sizeof text - used,
                 "%s{\"width\": 100, \"height\": 100, \"fx\": 90, \"fy\": 90, \"position\": [%.12g, %.12g, "
                 "%.12g], "
                 "\"rotation\": [[%.12g, %.12g, %.12g], [%.12g, %.12g, %.12g], [%.12g, %.12g, %.12g]]}",
                 i ? ", " : "", at[0], at[1], at[2], R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]);
    }
    strcat(text, "]");
    write_text("cameras.json", text);
}

/* The address that the program says. */
static void wait_for_page(pid_t pid, char url[256]) {
    double since = now();
    int status, there = 0;
    while (!there) {
        assert_false(has_ended(pid, since, &status));
        outcome o = take_outcome(0);
        there = strchr(o.out, '\n') && sscanf(o.out, "page: %255s", url) == 1;
        free_outcome(&o);
        test_pause_ms(20);
    }
}

static int is_shown(const char *selector) {
    char text[256];
    snprintf(text, sizeof text, "document.querySelector('%s').getClientRects().length > 0", selector);
    return browser_number(&shared, text) != 0;
}

static void test_finished_model(void **state) {
    fixture f = start();
    char url[256], before[1024];
    (void)state;
    if (program_set_up(NULL)) fail_msg("there is no program");
    sf_model *model = make_shaded(f.ctx, SF_MAX_SH_DEGREE);
    sf_camera camera = test_camera_around(1, 8, 100, 100);
    assert_ok(f.ctx, sf_model_save(model, work("blobs.ply")));
    write_cameras();
    pid_t pid = start_program(ARGS("view", "blobs.ply", "--listen", "127.0.0.1:0"), NULL);
    wait_for_page(pid, url);
    browser_open(&shared, address_of(url, &camera, 0.9));
    await_degree(SF_MAX_SH_DEGREE);
    await_drawing();
    fit_to_canvas(&camera, 0.9);
    double psnr = likeness(&f, model, camera);
    print_message("%d x %d: %.1f dB\n", camera.width, camera.height, psnr);
    assert_true(psnr > 30);
    /* Nothing but the model, and places to see it from. */
    assert_true(is_shown("#view") && is_shown("#to-model") && is_shown("#views-label"));
    assert_false(is_shown("#camera") || is_shown("#quality") || is_shown("#numbers") ||
                 is_shown("#to-pose") || is_shown("#follow") || is_shown("#buttons"));
    assert_int_equal(browser_number(&shared, "document.querySelector('#views').options.length"), 2);
    browser_resize(&shared, 1280, 800, 1, 0); /* nothing covers the tools there */
    assert_true(browser_number(&shared,
                               "(r => document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2)"
                               " === $('to-model'))($('to-model').getBoundingClientRect())") == 1);
    browser_resize(&shared, WIDTH, HEIGHT, 1, 0);
    snprintf(before, sizeof before, "%s", browser_text(&shared, "orbit.toText()"));
    browser_number(&shared, "$('views').value = 1, $('views').onchange(), 1");
    assert_string_not_equal(browser_text(&shared, "orbit.toText()"), before);
    camera = test_camera_around(3, 8, 100, 100);
    await_drawing();
    fit_to_canvas(&camera, 0.9);
    assert_true(likeness(&f, model, camera) > 30);
    assert_int_equal(kill(pid, SIGINT), 0);
    outcome o = wait_for(pid);
    assert_true(o.code == 0 && o.signal == 0);
    free_outcome(&o);
    sf_model_destroy(&model);
    end(&f);
}

/* ---- Figures, pictures, buttons ---- */

static int takes(fixture *f, sf_preview_command wanted) {
    sf_preview_command command = 0;
    for (int i = 0; i < 200; i++, test_pause_ms(50))
        if (sf_preview_take_command(f->p, &command)) return command == wanted;
    return 0;
}

static void press(fixture *f, const char *selector, sf_preview_command command) {
    browser_click(&shared, selector);
    assert_true(takes(f, command));
}

static void test_figures_and_buttons(void **state) {
    fixture f = start();
    sf_preview_command none;
    (void)state;
    browser_open(&shared, sf_preview_url(f.p));
    browser_await(&shared, "document.querySelector('#state').textContent == 'connected'");
    assert_true(browser_number(&shared, "document.querySelector('#buttons').hidden"));
    set_status(
        &f,
        "{\"state\": \"fitting\", \"steps\": 1234, \"buttons\": true, \"message\": \"<b>all is well</b>\"}");
    browser_await(&shared, "document.querySelector('#figures').textContent.includes('1,234')");
    assert_string_equal(browser_text(&shared, "document.querySelector('#message').textContent"),
                        "<b>all is well</b>");
    assert_true(browser_number(&shared, "document.querySelector('#lock').hidden"));
    press(&f, "#pause", SF_PREVIEW_PAUSE);
    set_status(&f, "{\"state\": \"paused\", \"steps\": 1240, \"buttons\": true, \"exposure_locked\": false}");
    browser_await(&shared, "document.querySelector('#pause').textContent == 'Go on'");
    press(&f, "#pause", SF_PREVIEW_GO_ON);
    press(&f, "#save", SF_PREVIEW_SAVE);
    press(&f, "#lock", SF_PREVIEW_LOCK_EXPOSURE);
    set_status(&f, "{\"state\": \"fitting\", \"buttons\": true, \"exposure_locked\": true}");
    browser_await(&shared, "document.querySelector('#lock').textContent == 'Unlock exposure'");
    press(&f, "#lock", SF_PREVIEW_UNLOCK_EXPOSURE);
    browser_click(&shared, "#reset"); /* asks first */
    browser_await(&shared, "document.querySelector('#reset').classList.contains('sure')");
    assert_false(sf_preview_take_command(f.p, &none));
    press(&f, "#reset", SF_PREVIEW_RESET);
    assert_false(sf_preview_take_command(f.p, &none));
    /* A status of nothing, and one of nonsense. */
    set_status(&f, "{}");
    browser_await(&shared, "document.querySelector('#buttons').hidden");
    set_status(&f, "{\"steps\": \"many\", \"pose\": {\"R_cw\": 1}, \"corners\": 7, \"state\": \"odd\"}");
    browser_await(&shared, "document.querySelector('#state').textContent == 'odd'");
    end(&f);
}

static const char pose[] =
    "\"pose\": {\"R_cw\": [1,0,0, 0,1,0, 0,0,1], \"t_cw\": [0,0,4], \"fx\": 140, \"fy\": 140, "
    "\"cx\": 80, \"cy\": 60, \"width\": 160, \"height\": 120}, \"pose_from\": \"board\"";

static void set_picture(fixture *f, sf_preview_part part, uint8_t grey) {
    static uint8_t rgb[SHOT_W * SHOT_H * 3];
    memset(rgb, grey, sizeof rgb);
    assert_ok(f->ctx, sf_preview_set_picture(f->p, part, SHOT_W, SHOT_H, rgb));
}

/* A channel of a pixel of a canvas. */
static double pixel(const char *canvas, int x, int y, int channel) {
    char text[256];
    snprintf(text, sizeof text,
             "(c => c.getContext('2d').getImageData(%d * c.width / 160, %d * c.width / 160, 1, 1).data[%d])"
             "(document.querySelector('#%s'))",
             x, y, channel, canvas);
    return browser_number(&shared, text);
}

static void test_pictures_and_overlay(void **state) {
    fixture f = start();
    (void)state;
    char text[1024];
    snprintf(text, sizeof text,
             "{%s, \"corners\": [[20,20],[50,20],[50,50],[20,50]], \"held_out_psnr\": 20, \"seconds\": 1}",
             pose);
    set_status(&f, text);
    set_picture(&f, SF_PREVIEW_CAMERA, 90);
    set_picture(&f, SF_PREVIEW_RENDER, 120);
    browser_open(&shared, sf_preview_url(f.p));
    browser_await(&shared, "!!(pictures.camera && pictures.render)");
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_CAMERA));
    assert_float_equal(pixel("camera", 5, 110, 0), 90, 3);
    assert_float_equal(pixel("render", 5, 110, 1), 120, 3);
    /* The tag's outline is yellow; the x axis, from the middle to the right, red; y down, green. */
    assert_true(pixel("camera", 35, 20, 0) > pixel("camera", 35, 20, 2) + 50);
    assert_true(pixel("camera", 95, 60, 0) > pixel("camera", 95, 60, 1) + 50);
    assert_true(pixel("camera", 80, 75, 1) > pixel("camera", 80, 75, 0) + 50);
    assert_float_equal(pixel("render", 95, 60, 0), 120, 3);
    set_picture(&f, SF_PREVIEW_CAMERA, 200);
    browser_await(
        &shared,
        "document.querySelector('#camera').getContext('2d').getImageData(5, 110, 1, 1).data[0] > 190");
    set_status(&f, "{\"held_out_psnr\": 23.25, \"seconds\": 9}");
    browser_await(
        &shared, "document.querySelector('#quality-facts').textContent.includes('23.25 dB held out at 9 s')");
    end(&f);
}

/* ---- Hands ---- */

static void test_hands(void **state) {
    fixture f = start();
    char text[1024], before[1024];
    (void)state;
    sf_model *model = make_blobs(f.ctx);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    snprintf(text, sizeof text, "{%s}", pose);
    set_status(&f, text);
    browser_open(&shared, sf_preview_url(f.p));
    await_drawing();
    /* It begins where the camera is. */
    snprintf(before, sizeof before, "%s", browser_text(&shared, "orbit.toText()"));
    assert_int_equal(strncmp(before, "1,0,0,0,1,0,0,0,1,0,0,4,1.166667,1.333333,", 42), 0);
    double x = browser_number(&shared, "document.querySelector('#view').getBoundingClientRect().left") + 200;
    double y = browser_number(&shared, "document.querySelector('#view').getBoundingClientRect().top") + 200;
    browser_mouse(&shared, "mousePressed", x, y);
    browser_mouse(&shared, "mouseMoved", x + 60, y);
    browser_mouse(&shared, "mouseReleased", x + 60, y);
    /* The front moved to the right: in this camera's frame the near side has z below the middle's. */
    assert_true(browser_number(&shared, "apply(orbit.view.R, [0, 0, -1])[0]") > 0.1);
    browser_await(&shared, "location.hash.startsWith('#view=')");
    /* Its link leads there. */
    assert_true(browser_number(&shared, "location.hash == '#view=' + orbit.toText()"));
    browser_click(&shared, "#to-pose");
    assert_string_equal(browser_text(&shared, "orbit.toText()"), before);
    browser_resize(&shared, 400, 800, 2, 1);
    browser_await(&shared, "document.querySelector('#view').clientWidth < 400");
    browser_number(&shared, "document.querySelector('#view').scrollIntoView({block: 'start'}) || 0");
    y = browser_number(&shared, "document.querySelector('#view').getBoundingClientRect().top") + 100;
    double start_at[2][2] = {{150, y}, {250, y}}, end_at[2][2] = {{100, y}, {300, y}};
    browser_touch(&shared, "touchStart", 2, (const double(*)[2])start_at);
    browser_touch(&shared, "touchMove", 2, (const double(*)[2])end_at);
    browser_touch(&shared, "touchEnd", 0, NULL);
    browser_await(&shared, "orbit.view.t[2] < 2.5"); /* twice as near */
    assert_true(browser_number(&shared, "Math.abs(orbit.view.t[0]) < 0.1"));
    browser_number(&shared, "scrollTo(0, 0)");
    sf_model_destroy(&model);
    end(&f);
}

/* ---- Places ---- */

static void test_small_screens(void **state) {
    fixture f = start();
    char text[1024];
    (void)state;
    snprintf(text, sizeof text,
             "{%s, \"state\": \"waiting for the board\", \"buttons\": true, \"exposure_locked\": true, "
             "\"message\": \"a_line_without_a_gap_that_is_longer_than_the_narrow_screens_of_phones_are\"}",
             pose);
    set_status(&f, text);
    browser_open(&shared, sf_preview_url(f.p));
    browser_await(&shared, "!document.querySelector('#buttons').hidden");
    static const int widths[] = {320, 375, 560, 768, 960, 1280, 1920};
    for (size_t i = 0; i < sizeof widths / sizeof *widths; i++) {
        browser_resize(&shared, widths[i], 640, 1, widths[i] < 500);
        test_pause_ms(100);
        assert_int_equal(browser_number(&shared, "document.documentElement.scrollWidth"), widths[i]);
    }
    end(&f);
}

static void test_it_comes_back(void **state) {
    (void)state;
    fixture f = start();
    char listen[64];
    set_status(&f, "{\"state\": \"first\"}");
    browser_open(&shared, sf_preview_url(f.p));
    browser_await(&shared, "document.querySelector('#state').textContent == 'first'");
    snprintf(listen, sizeof listen, "127.0.0.1:%d", atoi(strrchr(sf_preview_url(f.p), ':') + 1));
    sf_preview_close(&f.p);
    browser_await(&shared, "document.querySelector('#offline').textContent.includes('does not answer')");
    open_preview(&f, listen, "another-token");
    browser_await(&shared, "document.querySelector('#offline').textContent.includes('another token')");
    sf_preview_close(&f.p);
    open_preview(&f, listen, token);
    set_status(&f, "{\"state\": \"second\"}");
    browser_await(&shared, "document.querySelector('#state').textContent == 'second'");
    assert_true(browser_number(&shared, "document.querySelector('#offline').hidden"));
    end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_model_is_drawn),       cmocka_unit_test(test_harmonics_are_drawn),
        cmocka_unit_test(test_finished_model),       cmocka_unit_test(test_figures_and_buttons),
        cmocka_unit_test(test_pictures_and_overlay), cmocka_unit_test(test_hands),
        cmocka_unit_test(test_small_screens),        cmocka_unit_test(test_it_comes_back),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    if (shared.pid) browser_stop(&shared);
    return failed;
}
