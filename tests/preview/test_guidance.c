/* test_guidance.c - advice and coverage on the page in a real browser: what is drawn where, its button, and a
 * phone's layout. */
#include "browser.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/preview/preview.h"

enum { WIDTH = 1280, HEIGHT = 800, PHONE_WIDTH = 390, PHONE_HEIGHT = 844, GREY = 90 };

typedef struct fixture {
    sf_context *ctx;
    sf_preview *p;
} fixture;

static browser shared;

/* A camera at the origin that looks along z, and its picture of 160 x 120; the overlay's rows: well covered,
 * not known, badly covered. `worst`: JSON. */
static void show(const fixture *f, const char *advice, const char *worst) {
    static uint8_t rgb[160 * 120 * 3];
    char text[1024];
    memset(rgb, GREY, sizeof rgb);
    snprintf(text, sizeof text,
             "{\"state\": \"tracking\", \"buttons\": true, \"exposure_locked\": false, \"advice\": %s, "
             "\"pose\": {\"R_cw\": [1,0,0, 0,1,0, 0,0,1], \"t_cw\": [0,0,0], \"fx\": 140, \"fy\": 140, "
             "\"cx\": 80, \"cy\": 60, \"width\": 160, \"height\": 120}, \"pose_from\": \"none\", "
             "\"coverage\": {\"width\": 4, \"height\": 3, \"values\": \"9999....0000\", \"worst\": %s, "
             "\"worst_says\": \"go there\"}}",
             advice, worst);
    assert_ok(f->ctx, sf_preview_set_status(f->p, text));
    assert_ok(f->ctx, sf_preview_set_picture(f->p, SF_PREVIEW_CAMERA, 160, 120, rgb));
}

static fixture start(int width, int height) {
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK: a browser is slow there");
    if (!shared.pid) shared = browser_start(WIDTH, HEIGHT); /* skips where there is none */
    fixture f = {.ctx = test_context()};
    sf_preview_options o = {.listen = "127.0.0.1:0", .title = "guidance"};
    sf_status status = sf_preview_open(f.ctx, &o, &f.p);
    if (status == SF_ERR_UNSUPPORTED) {
        sf_context_destroy(&f.ctx);
        test_skip("not built with civetweb");
    }
    assert_ok(f.ctx, status);
    shared.exceptions = 0;
    browser_open(&shared, "about:blank");
    browser_resize(&shared, width, height, 1, width < 500);
    return f;
}

static void end(fixture *f) {
    assert_int_equal(shared.exceptions, 0);
    sf_preview_close(&f->p);
    sf_context_destroy(&f->ctx);
}

static void open_page(const fixture *f) {
    browser_open(&shared, sf_preview_url(f->p));
    browser_await(&shared, "!!pictures.camera");
}

/* A channel of a pixel of the camera's picture, as a JavaScript expression. */
static const char *pixel(int x, int y, int channel) {
    static char text[4][256];
    static int next;
    char *t = text[next++ % 4];
    snprintf(t, sizeof text[0],
             "(c => c.getContext('2d').getImageData(%d * c.width / 160, %d * c.width / 160, 1, 1).data[%d])"
             "(document.querySelector('#camera'))",
             x, y, channel);
    return t;
}

static double value(int x, int y, int channel) { return browser_number(&shared, pixel(x, y, channel)); }

/* What the program has still to publish for the page. */
static int await_wants(const fixture *f, int wanted) {
    for (int i = 0; i < 200; i++, test_pause_ms(50))
        if (!sf_preview_wants(f->p, SF_PREVIEW_COVERAGE) == !wanted) return 1;
    return 0;
}

static void coverage_lies_over_the_picture(void **state) {
    (void)state;
    fixture f = start(WIDTH, HEIGHT);
    show(&f, "null", "null");
    open_page(&f);
    assert_true(await_wants(&f, 1));
    assert_true(value(10, 5, 1) > value(10, 5, 0) + 20);     /* green above */
    assert_float_equal(value(10, 60, 0), GREY, 3);           /* nothing in the middle */
    assert_true(value(10, 115, 0) > value(10, 115, 1) + 50); /* red below */
    browser_click(&shared, "#coverage");
    browser_await(&shared, "document.querySelector('#coverage').getAttribute('aria-pressed') == 'false'");
    assert_float_equal(value(10, 115, 0), GREY, 3);
    assert_true(await_wants(&f, 0)); /* nobody needs it drawn */
    browser_click(&shared, "#coverage");
    browser_await(&shared, "document.querySelector('#coverage').getAttribute('aria-pressed') == 'true'");
    assert_true(value(10, 115, 0) > value(10, 115, 1) + 50);
    end(&f);
}

/* In sight a ring; out of sight, and behind, an arrow at the edge. */
static void an_arrow_leads_to_the_worst(void **state) {
    static const struct {
        const char *worst;
        double x, y;
        int inside;
    } cases[] = {{"[0.5, 0, 2]", 115, 60, 1},
                 {"[9, 0, 2]", 160, 60, 0},
                 {"[-9, 0, 2]", 0, 60, 0},
                 {"[0, -9, 2]", 80, 0, 0},
                 {"[1, 0, -4]", 160, 60, 0}};
    (void)state;
    fixture f = start(WIDTH, HEIGHT);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        show(&f, "null", cases[i].worst);
        open_page(&f);
        snprintf(text, sizeof text,
                 "(w => w.inside == %s && Math.abs(w.x - %g) < 12 && Math.abs(w.y - %g) < 12)"
                 "(wayTo(status.coverage.worst, pose(), {width: 160, height: 120}, 10))",
                 cases[i].inside ? "true" : "false", cases[i].x, cases[i].y);
        browser_await(&shared, text);
    }
    /* The last one's arrow is red, at the right edge. */
    double most = 0;
    for (int x = 125; x < 158; x++) {
        double red = value(x, 60, 0) - value(x, 60, 1);
        if (red > most) most = red;
    }
    assert_true(most > 100);
    end(&f);
}

static void nonsense_is_not_drawn(void **state) {
    (void)state;
    fixture f = start(WIDTH, HEIGHT);
    show(&f, "null", "[1, \"x\"]");
    open_page(&f);
    assert_ok(f.ctx,
              sf_preview_set_status(f.p, "{\"coverage\": {\"width\": 9, \"height\": 3, \"values\": \"12\"}, "
                                         "\"advice\": 7, \"state\": \"odd\"}"));
    browser_await(&shared, "document.querySelector('#state').textContent == 'odd'");
    test_pause_ms(300);
    end(&f);
}

/* Advice over the picture; buttons where a thumb is, large enough; nothing wider than the screen. */
static void a_phone_is_held_in_one_hand(void **state) {
    (void)state;
    fixture f = start(PHONE_WIDTH, PHONE_HEIGHT);
    show(&f, "\"slower\"", "[9, 0, 2]");
    open_page(&f);
    browser_await(&shared, "document.querySelector('#advice').textContent == 'slower'");
    assert_true(browser_number(&shared, "(a => (p => a.top >= p.top && a.bottom <= p.bottom)"
                                        "(document.querySelector('#camera').getBoundingClientRect()))"
                                        "(document.querySelector('#advice').getBoundingClientRect())"));
    assert_float_equal(
        browser_number(&shared, "document.querySelector('#buttons').getBoundingClientRect().bottom"),
        PHONE_HEIGHT, 1);
    assert_true(browser_number(&shared,
                               "[...document.querySelectorAll('#buttons button'), "
                               "document.querySelector('#coverage')].every(b => b.offsetHeight >= 44)"));
    assert_true(browser_number(&shared, "document.querySelector('#camera').getBoundingClientRect().bottom < "
                                        "document.querySelector('#view').getBoundingClientRect().top"));
    assert_int_equal(browser_number(&shared, "document.documentElement.scrollWidth"), PHONE_WIDTH);
    show(&f, "null", "null");
    browser_await(&shared, "document.querySelector('#advice').hidden");
    end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coverage_lies_over_the_picture), cmocka_unit_test(an_arrow_leads_to_the_worst),
        cmocka_unit_test(nonsense_is_not_drawn), cmocka_unit_test(a_phone_is_held_in_one_hand)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    if (shared.pid) browser_stop(&shared);
    return failed;
}
