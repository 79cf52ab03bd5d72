/* browser.c - see browser.h. */
#include "browser.h"

#include "../../src/io/picture.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "../../src/base/clock.h"

static const double patience = 30; /* s; a loaded machine starts a browser slowly */

/* ---- Starting and ending ---- */

static const char *find_browser(void) {
    const char *named = getenv("SPLATFIT_CHROMIUM");
    static const char *const places[] = {"/usr/bin/chromium", "/usr/bin/chromium-browser",
                                         "/usr/bin/chromium-headless-shell"};
    if (named) return named;
    for (size_t i = 0; i < sizeof places / sizeof *places; i++)
        if (!access(places[i], X_OK)) return places[i];
    return NULL;
}

/* A test that fails leaves its own behind. */
static pid_t running[16];
static int started;

static void kill_all(void) {
    for (int i = 0; i < started; i++)
        if (running[i]) kill(-running[i], SIGKILL);
}

static void run_browser(const char *program, int in, int out) {
    char folder[1100], name[32];
    snprintf(name, sizeof name, "browser-%d", started);
    snprintf(folder, sizeof folder, "--user-data-dir=%s", test_path(name));
    int kept_in = fcntl(in, F_DUPFD, 10), kept_out = fcntl(out, F_DUPFD, 10),
        quiet = open("/dev/null", O_RDWR);
    dup2(quiet, 0);
    dup2(quiet, 1);
    dup2(quiet, 2);
    dup2(kept_in, 3);
    dup2(kept_out, 4);
    for (int fd = 5; fd < 64; fd++) close(fd);
    execl(program, program, "--headless", "--remote-debugging-pipe", "--no-sandbox",
          "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run", "--no-proxy-server",
          "--disable-background-networking", "--disable-component-update", "--disable-sync",
          "--disable-extensions", "--disable-dev-shm-usage", "--hide-scrollbars", "--mute-audio", folder,
          "about:blank", (char *)NULL);
    _exit(127);
}

browser browser_start(int width, int height) {
    browser b = {0};
    int to[2], from[2];
    const char *program = find_browser();
    if (!program) test_skip("there is no Chromium");
    test_folder(); /* before the fork: it is the parent's to remove */
    assert_int_equal(pipe(to), 0);
    assert_int_equal(pipe(from), 0);
    signal(SIGPIPE, SIG_IGN);
    b.pid = fork();
    assert_true(b.pid >= 0 && started < 16);
    if (b.pid == 0) {
        setpgid(0, 0);
        run_browser(program, to[0], from[1]);
    }
    if (!started) atexit(kill_all);
    running[started++] = b.pid;
    close(to[0]);
    close(from[1]);
    b.to = to[1];
    b.from = from[0];
    json_t *target = browser_call(&b, "Target.createTarget", json_pack("{ss}", "url", "about:blank"));
    json_t *session =
        browser_call(&b, "Target.attachToTarget",
                     json_pack("{sOsb}", "targetId", json_object_get(target, "targetId"), "flatten", 1));
    snprintf(b.session, sizeof b.session, "%s", json_string_value(json_object_get(session, "sessionId")));
    json_decref(session);
    json_decref(target);
    json_decref(browser_call(&b, "Page.enable", NULL));
    json_decref(browser_call(&b, "Runtime.enable", NULL));
    browser_resize(&b, width, height, 1, 0);
    return b;
}

void browser_stop(browser *b) {
    close(b->to);
    close(b->from);
    kill(-b->pid, SIGKILL);
    waitpid(b->pid, NULL, 0);
    for (int i = 0; i < started; i++)
        if (running[i] == b->pid) running[i] = 0;
    free(b->pending);
}

/* ---- The protocol: JSON, each followed by a 0 ---- */

static void write_all(browser *b, const char *text) {
    for (size_t left = strlen(text) + 1; left > 0;) {
        ssize_t n = write(b->to, text, left);
        if (n <= 0) fail_msg("the browser takes nothing: %s", strerror(errno));
        text += n;
        left -= (size_t)n;
    }
}

static json_t *next_message(browser *b, const char *what) {
    double limit = sf_clock() + patience;
    for (;;) {
        char *end = b->used ? memchr(b->pending, 0, b->used) : NULL;
        if (end) {
            json_t *message = json_loads(b->pending, 0, NULL);
            size_t size = (size_t)(end - b->pending) + 1;
            memmove(b->pending, b->pending + size, b->used -= size);
            assert_non_null(message);
            return message;
        }
        if (b->room - b->used < 65536) assert_non_null(b->pending = realloc(b->pending, b->room += 1 << 20));
        struct pollfd p = {.fd = b->from, .events = POLLIN};
        if (sf_clock() > limit || poll(&p, 1, 1000) < 0) fail_msg("%s: the browser does not answer", what);
        if (!p.revents) continue;
        ssize_t n = read(b->from, b->pending + b->used, b->room - b->used);
        if (n <= 0) fail_msg("%s: the browser is gone", what);
        b->used += (size_t)n;
    }
}

json_t *browser_call(browser *b, const char *method, json_t *parameters) {
    json_t *call = json_pack("{sissso}", "id", ++b->calls, "method", method, "params",
                             parameters ? parameters : json_object());
    if (*b->session) json_object_set_new(call, "sessionId", json_string(b->session));
    char *text = json_dumps(call, JSON_COMPACT);
    write_all(b, text);
    free(text);
    json_decref(call);
    for (;;) {
        json_t *message = next_message(b, method);
        const char *event = json_string_value(json_object_get(message, "method"));
        if (event && !strcmp(event, "Runtime.exceptionThrown")) {
            char *said = json_dumps(json_object_get(message, "params"), JSON_COMPACT);
            print_message("%.800s\n", said);
            free(said);
            b->exceptions++;
        }
        if (json_integer_value(json_object_get(message, "id")) == b->calls) {
            json_t *result = json_incref(json_object_get(message, "result"));
            if (!result) fail_msg("%s: %s", method, json_dumps(message, JSON_COMPACT));
            json_decref(message);
            return result;
        }
        json_decref(message);
    }
}

/* ---- A page ---- */

void browser_open(browser *b, const char *url) {
    json_decref(browser_call(b, "Page.navigate", json_pack("{ss}", "url", url)));
    browser_await(b, "document.readyState == 'complete'");
}

void browser_resize(browser *b, int width, int height, double ratio, int phone) {
    json_decref(browser_call(b, "Emulation.setDeviceMetricsOverride",
                             json_pack("{sisisfsb}", "width", width, "height", height, "deviceScaleFactor",
                                       ratio, "mobile", phone)));
    json_decref(browser_call(b, "Emulation.setTouchEmulationEnabled", json_pack("{sb}", "enabled", phone)));
}

void browser_scheme(browser *b, const char *scheme) {
    json_decref(
        browser_call(b, "Emulation.setEmulatedMedia",
                     json_pack("{s[{ssss}]}", "features", "name", "prefers-color-scheme", "value", scheme)));
}

static json_t *evaluate(browser *b, const char *expression) {
    json_t *all = browser_call(b, "Runtime.evaluate",
                               json_pack("{sssb}", "expression", expression, "returnByValue", 1));
    if (json_object_get(all, "exceptionDetails"))
        fail_msg("%s: %s", expression, json_dumps(all, JSON_COMPACT));
    json_t *value = json_incref(json_object_get(json_object_get(all, "result"), "value"));
    json_decref(all);
    return value;
}

double browser_number(browser *b, const char *expression) {
    json_t *value = evaluate(b, expression);
    double number = json_is_true(value) ? 1 : json_number_value(value);
    json_decref(value);
    return number;
}

const char *browser_text(browser *b, const char *expression) {
    static char buffers[4][4096];
    static unsigned turn;
    char *text = buffers[turn++ % 4];
    json_t *value = evaluate(b, expression);
    snprintf(text, sizeof buffers[0], "%s", json_is_string(value) ? json_string_value(value) : "");
    json_decref(value);
    return text;
}

void browser_await(browser *b, const char *expression) {
    char text[1024];
    snprintf(text, sizeof text, "(() => { try { return %s; } catch { return false; } })()", expression);
    for (double limit = sf_clock() + patience; !browser_number(b, text); test_pause_ms(50))
        if (sf_clock() > limit || b->exceptions) fail_msg("never true: %s", expression);
}

/* ---- Hands ---- */

static void place_of(browser *b, const char *selector, double place[4]) {
    static const char *const sides[] = {"left", "top", "width", "height"};
    char text[512];
    snprintf(text, sizeof text,
             "document.querySelector('%s').scrollIntoView({block: 'center', behavior: 'instant'})", selector);
    json_decref(evaluate(b, text));
    for (int i = 0; i < 4; i++) {
        snprintf(text, sizeof text, "document.querySelector('%s').getBoundingClientRect().%s", selector,
                 sides[i]);
        place[i] = browser_number(b, text);
    }
}

void browser_mouse(browser *b, const char *type, double x, double y) {
    int pressed = strcmp(type, "mouseReleased") != 0;
    json_decref(browser_call(b, "Input.dispatchMouseEvent",
                             json_pack("{sssfsfsssisi}", "type", type, "x", x, "y", y, "button", "left",
                                       "buttons", pressed, "clickCount", 1)));
}

void browser_click(browser *b, const char *selector) {
    double place[4];
    place_of(b, selector, place);
    double x = place[0] + place[2] / 2, y = place[1] + place[3] / 2;
    browser_mouse(b, "mousePressed", x, y);
    browser_mouse(b, "mouseReleased", x, y);
}

void browser_touch(browser *b, const char *type, int n, const double (*at)[2]) {
    json_t *points = json_array();
    for (int i = 0; i < n; i++)
        json_array_append_new(points, json_pack("{sfsfsi}", "x", at[i][0], "y", at[i][1], "id", i));
    json_decref(browser_call(b, "Input.dispatchTouchEvent",
                             json_pack("{ssso}", "type", type, "touchPoints", points)));
}

/* ---- Pictures ---- */

static uint8_t *from_base64(const char *text, size_t *size) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    uint8_t *data = malloc(strlen(text) + 1);
    uint32_t bits = 0;
    int held = 0;
    assert_non_null(data);
    *size = 0;
    for (const char *at; *text && (at = strchr(digits, *text)); text++) {
        bits = bits << 6 | (uint32_t)(at - digits);
        held += 6;
        if (held < 8) continue;
        held -= 8;
        data[(*size)++] = (uint8_t)(bits >> held);
    }
    return data;
}

void browser_picture(browser *b, const char *selector, const char *path) {
    json_t *parameters = json_pack("{ss}", "format", "png");
    if (selector) {
        double p[4];
        place_of(b, selector, p);
        p[0] += browser_number(b, "scrollX");
        p[1] += browser_number(b, "scrollY");
        json_object_set_new(
            parameters, "clip",
            json_pack("{sfsfsfsfsi}", "x", p[0], "y", p[1], "width", p[2], "height", p[3], "scale", 1));
    }
    json_t *result = browser_call(b, "Page.captureScreenshot", parameters);
    size_t size;
    uint8_t *data = from_base64(json_string_value(json_object_get(result, "data")), &size);
    test_write(path, data, size);
    free(data);
    json_decref(result);
}

float *browser_pixels(browser *b, sf_context *ctx, const char *selector, int width, int height) {
    sf_picture picture;
    browser_picture(b, selector, test_path("seen.png"));
    assert_ok(ctx, sf_picture_load(ctx, test_path("seen.png"), &picture));
    assert_int_equal(picture.width, width);
    assert_int_equal(picture.height, height);
    size_t pixels = (size_t)width * (size_t)height;
    float *rgb = malloc(3 * pixels * sizeof *rgb);
    assert_non_null(rgb);
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) rgb[3 * i + c] = picture.rgb[c * pixels + i] / 255.0f;
    sf_picture_free(ctx, &picture);
    return rgb;
}
