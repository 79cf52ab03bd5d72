/* test_preview.c - the page's server over real sockets: what it gives, to whom, and what it withstands. */
#include "testing.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "../../src/base/clock.h"
#include "../../src/base/memory.h"
#include "../../src/io/picture.h"
#include "../../src/preview/guard.h"
#include "../../src/preview/preview.h"

/* ---- A client ---- */

typedef struct answer {
    int code;
    char head[4096];
    uint8_t *body; /* free()d by the caller; followed by a 0 */
    size_t size;
} answer;

static int port_of(const sf_preview *p) {
    const char *colon = strchr(sf_preview_url(p) + strlen("http://"), ':');
    assert_non_null(colon);
    return atoi(colon + 1);
}

static int dial(int port) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_true(fd >= 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    struct timeval limit = {.tv_sec = 60};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    return fd;
}

static void send_text(int fd, const char *text) {
    size_t size = strlen(text);
    while (size > 0) {
        ssize_t sent = send(fd, text, size, MSG_NOSIGNAL);
        if (sent <= 0) return;
        text += sent;
        size -= (size_t)sent;
    }
}

/* All up to the end of the connection; *size bytes, followed by a 0. */
static uint8_t *receive(int fd, size_t *size) {
    size_t room = 1 << 14;
    uint8_t *data = malloc(room);
    ssize_t got;
    assert_non_null(data);
    *size = 0;
    while ((got = recv(fd, data + *size, room - *size - 1, 0)) > 0) {
        *size += (size_t)got;
        if (*size + 1 == room) assert_non_null(data = realloc(data, room *= 2));
    }
    data[*size] = 0;
    return data;
}

static answer receive_answer(int fd) {
    answer a = {0};
    size_t size;
    uint8_t *all = receive(fd, &size);
    char *end = strstr((char *)all, "\r\n\r\n");
    if (end) {
        size_t head = (size_t)(end - (char *)all) + 4;
        snprintf(a.head, sizeof a.head, "%.*s", (int)head, (char *)all);
        sscanf(a.head, "HTTP/1.1 %d", &a.code);
        a.size = size - head;
        memmove(all, all + head, a.size + 1);
    }
    a.body = all;
    close(fd);
    return a;
}

/* A request as it is, with its headers, and its answer. */
static answer ask_raw(int port, const char *request) {
    int fd = dial(port);
    send_text(fd, request);
    return receive_answer(fd);
}

/* `headers`: each with its end of line. */
static answer ask_with(const sf_preview *p, const char *method, const char *path, const char *headers,
                       const char *body) {
    char request[4096];
    snprintf(request, sizeof request, "%s %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n%s\r\n%s", method, path,
             port_of(p), headers, body);
    return ask_raw(port_of(p), request);
}

static answer get(const sf_preview *p, const char *path) { return ask_with(p, "GET", path, "", ""); }

static int code_of(answer a) {
    free(a.body);
    return a.code;
}

static answer post(const sf_preview *p, const char *headers, const char *body) {
    char all[1024];
    snprintf(all, sizeof all, "Content-Type: application/json\r\nContent-Length: %zu\r\n%s", strlen(body),
             headers);
    return ask_with(p, "POST", "/command", all, body);
}

static json_t *get_json(const sf_preview *p, const char *path) {
    answer a = get(p, path);
    assert_int_equal(a.code, 200);
    json_t *json = json_loadb((char *)a.body, a.size, 0, NULL);
    assert_non_null(json);
    free(a.body);
    return json;
}

/* ---- What is served ---- */

typedef struct fixture {
    sf_context *ctx;
    sf_preview *p;
} fixture;

static fixture open_with(const char *listen, const char *token) {
    fixture f = {.ctx = test_context()};
    sf_preview_options o = {.listen = listen, .token = token, .title = "a \"scene\" <b>"};
#ifndef SF_HAVE_CIVETWEB
    assert_status(f.ctx, sf_preview_open(f.ctx, &o, &f.p), SF_ERR_UNSUPPORTED);
    assert_error_names(f.ctx, "civetweb");
    sf_context_destroy(&f.ctx);
    test_skip("not built with civetweb");
#endif
    assert_ok(f.ctx, sf_preview_open(f.ctx, &o, &f.p));
    return f;
}

static fixture open_one(void) { return open_with("127.0.0.1:0", NULL); }

static void close_one(fixture *f) {
    sf_preview_close(&f->p);
    assert_null(f->p);
    sf_context_destroy(&f->ctx);
}

static sf_model *some_model(sf_context *ctx, size_t count) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, 0, &model));
    for (size_t i = 0; i < count; i++) {
        float v = (float)(i % 97) / 97, mean[3] = {v, 1 - v, (float)i / 1000}, quat[4] = {1, v, 0, -v},
              scale[3] = {-4 + v, -5, -4 - v}, logit = 3 * v, sh[3] = {v, -v, 0.5f};
        sf_gaussians g = {mean, quat, scale, &logit, sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &g));
    }
    return model;
}

static void test_page(void **state) {
    fixture f = open_one();
    (void)state;
    assert_null(strstr(sf_preview_url(f.p), "token"));
    answer a = get(f.p, "/");
    assert_int_equal(a.code, 200);
    assert_non_null(strstr(a.head, "text/html"));
    assert_non_null(strstr(a.head, "Content-Security-Policy"));
    assert_null(strstr(a.head, "Set-Cookie"));
    assert_non_null(strstr((char *)a.body, "<!doctype html>"));
    /* One document: nothing of it comes from elsewhere. */
    assert_null(strstr((char *)a.body, "<link rel=\"stylesheet\""));
    assert_null(strstr((char *)a.body, "<script src"));
    assert_null(strstr((char *)a.body, "https://"));
    free(a.body);
    a = ask_with(f.p, "HEAD", "/", "", "");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, 0);
    free(a.body);
    assert_int_equal(code_of(get(f.p, "/etc/passwd")), 404);
    assert_int_equal(code_of(get(f.p, "/../../etc/passwd")), 404);
    assert_int_equal(code_of(get(f.p, "/%2e%2e/%2e%2e/etc/passwd")), 404);
    assert_int_equal(code_of(ask_with(f.p, "PUT", "/", "Content-Length: 0\r\n", "")), 405);
    assert_int_equal(code_of(ask_with(f.p, "DELETE", "/page.html", "", "")), 405);
    assert_int_equal(code_of(get(f.p, "/command")), 405);
    close_one(&f);
}

static void test_status(void **state) {
    fixture f = open_one();
    (void)state;
    json_t *json = get_json(f.p, "/status");
    assert_string_equal(json_string_value(json_object_get(json, "title")), "a \"scene\" <b>");
    assert_int_equal(json_object_size(json_object_get(json, "status")), 0);
    json_decref(json);
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"state\": \"fitting\", \"steps\": 12, \"seconds\": 1.5}"));
    json = get_json(f.p, "/status");
    const json_t *status = json_object_get(json, "status");
    assert_string_equal(json_string_value(json_object_get(status, "state")), "fitting");
    assert_int_equal(test_number(status, "steps"), 12);
    json_decref(json);
    /* What is no object leaves it. */
    assert_status(f.ctx, sf_preview_set_status(f.p, "{\"steps\": "), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_status(f.p, "[1]"), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_status(f.p, "{\"a\": nan}"), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "status");
    json = get_json(f.p, "/status");
    assert_int_equal(test_number(json_object_get(json, "status"), "steps"), 12);
    json_decref(json);
    close_one(&f);
}

static void set_point(fixture *f, double seconds, double psnr) {
    char text[128];
    snprintf(text, sizeof text, "{\"seconds\": %g, \"held_out_psnr\": %g}", seconds, psnr);
    assert_ok(f->ctx, sf_preview_set_status(f->p, text));
}

static void test_history(void **state) {
    fixture f = open_one();
    (void)state;
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"seconds\": 0}"));
    set_point(&f, 1, 20);
    set_point(&f, 2, 20);
    set_point(&f, 3, 21);
    json_t *json = get_json(f.p, "/history"), *points = json_object_get(json, "points");
    assert_int_equal(json_array_size(points), 2);
    const json_t *second = json_array_get(points, 1);
    assert_float_equal(json_number_value(json_array_get(second, 0)), 3, 1e-9);
    assert_float_equal(json_number_value(json_array_get(second, 1)), 21, 1e-9);
    assert_true(json_is_null(json_array_get(second, 2)));
    json_decref(json);
    /* A long run stays in its bounds, from its first point to its last. */
    for (int i = 0; i < 5000; i++) set_point(&f, 4 + i, 20 + i % 7);
    json = get_json(f.p, "/history");
    points = json_object_get(json, "points");
    size_t n = json_array_size(points);
    assert_between(n, 512, 1024);
    assert_float_equal(json_number_value(json_array_get(json_array_get(points, 0), 0)), 1, 1e-9);
    assert_float_equal(json_number_value(json_array_get(json_array_get(points, n - 1), 0)), 5003, 1e-9);
    json_decref(json);
    set_point(&f, 0, 5); /* begun anew */
    json = get_json(f.p, "/history");
    assert_int_equal(json_array_size(json_object_get(json, "points")), 1);
    json_decref(json);
    close_one(&f);
}

static void header_value(const answer *a, const char *name, char *value, size_t size) {
    const char *at = strstr(a->head, name);
    assert_non_null(at);
    at += strlen(name);
    snprintf(value, size, "%.*s", (int)strcspn(at, "\r"), at);
}

static void test_pictures(void **state) {
    enum { W = 40, H = 24 };
    fixture f = open_one();
    static uint8_t rgb[W * H * 3];
    (void)state;
    assert_int_equal(code_of(get(f.p, "/camera.jpg")), 404);
    for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = i % 3 == 0 ? 200 : i % 3 == 1 ? 100 : 30;
    assert_ok(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W, H, rgb));
    assert_int_equal(code_of(get(f.p, "/render.jpg")), 404);
    answer a = get(f.p, "/camera.jpg");
    assert_int_equal(a.code, 200);
    test_write(test_path("camera.jpg"), a.body, a.size);
    sf_picture picture;
    assert_ok(f.ctx, sf_picture_load(f.ctx, test_path("camera.jpg"), &picture));
    assert_int_equal(picture.width, W);
    assert_int_equal(picture.height, H);
    assert_between(picture.rgb[0], 196, 204);
    assert_between(picture.rgb[W * H], 96, 104);
    assert_between(picture.rgb[2 * W * H], 26, 34);
    sf_picture_free(f.ctx, &picture);
    free(a.body);
    /* One that the client has is not sent again, until there is another. */
    char tag[128], known[256];
    header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(known, sizeof known, "If-None-Match: %s\r\n", tag);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/camera.jpg", known, "")), 304);
    assert_ok(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W / 2, H, rgb));
    assert_int_equal(code_of(ask_with(f.p, "GET", "/camera.jpg", known, "")), 200);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_MODEL, W, H, rgb), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, 0, H, rgb), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W, 16385, rgb), SF_ERR_ARGUMENT);
    close_one(&f);
}

static void test_model(void **state) {
    enum { COUNT = 5000 };
    fixture f = open_one();
    (void)state;
    assert_int_equal(code_of(get(f.p, "/model.splat")), 404);
    sf_model *model = some_model(f.ctx, COUNT);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    assert_ok(f.ctx, sf_model_save(model, test_path("model.splat")));
    size_t size;
    uint8_t *file = test_read(test_path("model.splat"), &size);
    answer a = get(f.p, "/model.splat");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, size);
    assert_memory_equal(a.body, file, size);
    free(a.body);
    /* In parts, of one version. */
    char tag[128], headers[512];
    header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(headers, sizeof headers, "If-None-Match: %s\r\n", tag);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/model.splat", headers, "")), 304);
    snprintf(headers, sizeof headers, "If-Match: %s\r\nRange: bytes=100-4195\r\n", tag);
    for (int publishes = 0; publishes < 3; publishes++) {
        a = ask_with(f.p, "GET", "/model.splat", headers, "");
        if (publishes < 2) { /* the one before the newest is still there */
            assert_int_equal(a.code, 206);
            assert_int_equal(a.size, 4096);
            assert_memory_equal(a.body, file + 100, 4096);
            assert_non_null(strstr(a.head, "Content-Range: bytes 100-4195/160000"));
        } else {
            assert_int_equal(a.code, 412);
        }
        free(a.body);
        assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    }
    assert_int_equal(code_of(ask_with(f.p, "GET", "/model.splat", "Range: bytes=160000-\r\n", "")), 416);
    a = ask_with(f.p, "GET", "/model.splat", "Range: bytes=159990-999999999999999999999\r\n", "");
    assert_int_equal(a.code, 206);
    assert_int_equal(a.size, 10);
    free(a.body);
    static const char *const odd[] = {"bytes=-5", "bytes=5-4", "bytes=a-b", "bytes=1-2,5-6", "lines=1-2"};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        snprintf(headers, sizeof headers, "Range: %s\r\n", odd[i]);
        int code = code_of(ask_with(f.p, "GET", "/model.splat", headers, ""));
        assert_true(code == 200 || code == 416);
    }
    sf_model_destroy(&model);
    /* A model of nothing is one. */
    model = some_model(f.ctx, 0);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    a = get(f.p, "/model.splat");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, 0);
    free(a.body);
    sf_model_destroy(&model);
    free(file);
    close_one(&f);
}

/* What a .splat leaves out, in its order: the heaviest Gaussian, which is the second, comes first. */
static void test_sh(void **state) {
    fixture f = open_one();
    sf_model *model;
    (void)state;
    assert_int_equal(code_of(get(f.p, "/model.sh")), 404);
    assert_ok(f.ctx, sf_model_create(f.ctx, 2, 3, &model));
    float mean[3] = {0}, quat[4] = {1}, scale[3] = {-4, -4, -4}, logit = 2, sh[48] = {0};
    const sf_gaussians g = {mean, quat, scale, &logit, sh};
    sh[0] = 5, sh[1] = -5; /* colours 1.91 and -0.91 */
    sh[3] = 0.25f, sh[11] = -3, sh[47] = 3;
    assert_ok(f.ctx, sf_model_set(model, 0, 1, &g));
    memset(sh, 0, sizeof sh);
    sh[3] = -0.5f;
    scale[0] = -3;
    assert_ok(f.ctx, sf_model_set(model, 1, 1, &g));
    static const size_t size[] = {0, 16, 32, 48, 48};
    for (int degree = 0; degree < 5; degree++) {
        assert_ok(f.ctx, sf_preview_set_model(f.p, model, degree));
        json_t *json = get_json(f.p, "/status");
        assert_int_equal(test_number(json_object_get(json, "model"), "sh_degree"), degree < 3 ? degree : 3);
        json_decref(json);
        answer a = get(f.p, "/model.sh");
        assert_int_equal(a.code, 200);
        assert_int_equal(a.size, 2 * size[degree]);
        const uint8_t *second = a.body + size[degree];
        if (degree > 0) {
            assert_true(a.body[0] == 128 && a.body[3] == 64 && a.body[4] == 128);
            assert_true(second[0] == 245 && second[1] == 11 && second[2] == 128);
            assert_true(second[3] == 160 && second[11] == 0 && second[12] == 128);
            assert_int_equal(second[size[degree] - 1], degree < 3 ? 128 : 255);
        }
        free(a.body);
    }
    answer a = ask_with(f.p, "GET", "/model.sh", "Range: bytes=90-\r\n", "");
    assert_int_equal(a.code, 206);
    assert_int_equal(a.size, 6);
    free(a.body);
    /* As many bands as there is room for. */
    assert_int_equal(sf_preview_sh_within(1000, 48000), 3);
    assert_int_equal(sf_preview_sh_within(1000, 47999), 2);
    assert_int_equal(sf_preview_sh_within(1000, 16000), 1);
    assert_int_equal(sf_preview_sh_within(1000, 15999), 0);
    assert_int_equal(sf_preview_sh_within(0, 0), 3);
    sf_model_destroy(&model);
    close_one(&f);
}

static void test_wants(void **state) {
    fixture f = open_one();
    (void)state;
    const int all = SF_PREVIEW_CAMERA | SF_PREVIEW_RENDER | SF_PREVIEW_MODEL | SF_PREVIEW_STATUS;
    assert_false(sf_preview_wants(f.p, all));
    assert_int_equal(code_of(get(f.p, "/status?want=cm")), 200);
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_CAMERA));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_STATUS));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_RENDER | SF_PREVIEW_CAMERA));
    assert_false(sf_preview_wants(f.p, SF_PREVIEW_RENDER));
    /* Who is in the middle of an older model holds up the next. */
    sf_model *model = some_model(f.ctx, 100);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    answer a = ask_with(f.p, "GET", "/model.splat", "Range: bytes=0-31\r\n", "");
    free(a.body);
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    char tag[128], headers[256];
    header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(headers, sizeof headers, "If-Match: %s\r\nRange: bytes=32-63\r\n", tag);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/model.splat", headers, "")), 206);
    assert_false(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    sf_model_destroy(&model);
    close_one(&f);
}

/* ---- Who may ---- */

static void test_token(void **state) {
    fixture f = open_with("127.0.0.1:0", "a-Token_of-tests");
    (void)state;
    assert_non_null(strstr(sf_preview_url(f.p), "/?token=a-Token_of-tests"));
    static const char *const all[] = {"/", "/status", "/history", "/camera.jpg", "/model.splat", "/nothing"};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        answer a = get(f.p, all[i]);
        assert_int_equal(a.code, 403);
        assert_ptr_equal(strchr((char *)a.body, '\n'), (char *)a.body + a.size - 1); /* one line */
        free(a.body);
    }
    assert_int_equal(code_of(get(f.p, "/?token=")), 403);
    assert_int_equal(code_of(get(f.p, "/?token=a-Token_of-test")), 403);
    assert_int_equal(code_of(get(f.p, "/?token=a-Token_of-testsX")), 403);
    assert_int_equal(code_of(get(f.p, "/?token=a-token_of-tests")), 403);
    assert_int_equal(code_of(post(f.p, "", "{\"command\":\"save\"}")), 403);
    answer a = get(f.p, "/?token=a-Token_of-tests");
    assert_int_equal(a.code, 200);
    char cookie[256], headers[512];
    header_value(&a, "Set-Cookie: ", cookie, sizeof cookie);
    assert_non_null(strstr(cookie, "HttpOnly"));
    assert_non_null(strstr(cookie, "SameSite=Strict"));
    free(a.body);
    snprintf(headers, sizeof headers, "Cookie: other=1; %.*s\r\n", (int)strcspn(cookie, ";"), cookie);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/status", headers, "")), 200);
    headers[strlen(headers) - 3] ^= 1;
    assert_int_equal(code_of(ask_with(f.p, "GET", "/status", headers, "")), 403);
    assert_int_equal(
        code_of(ask_with(f.p, "GET", "/status", "Authorization: Bearer a-Token_of-tests\r\n", "")), 200);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/status", "Authorization: Bearer x\r\n", "")), 403);
    close_one(&f);
}

static void test_token_made(void **state) {
    fixture f = open_with("0.0.0.0:0", NULL);
    (void)state;
    const char *token = strstr(sf_preview_url(f.p), "?token=");
    assert_non_null(token); /* never beyond this machine without */
    assert_int_equal(strlen(token + 7), 32);
    assert_null(strstr(sf_preview_url(f.p), "0.0.0.0"));
    char path[64], other[33];
    snprintf(other, sizeof other, "%s", token + 7);
    assert_int_equal(code_of(get(f.p, "/status")), 403);
    snprintf(path, sizeof path, "/status%s", token);
    assert_int_equal(code_of(get(f.p, path)), 200);
    close_one(&f);
    f = open_with("0.0.0.0:0", NULL);
    assert_null(strstr(sf_preview_url(f.p), other));
    close_one(&f);
}

static int code_for_host(const sf_preview *p, const char *host) {
    char request[512];
    snprintf(request, sizeof request, "GET /status HTTP/1.1\r\nHost: %s\r\n\r\n", host);
    return code_of(ask_raw(port_of(p), request));
}

static void test_host_and_origin(void **state) {
    fixture f = open_one();
    (void)state;
    char origin[128];
    assert_int_equal(code_for_host(f.p, "localhost:8090"), 200);
    assert_int_equal(code_for_host(f.p, "127.0.0.1"), 200);
    assert_int_equal(code_for_host(f.p, "evil.example"), 403);
    assert_int_equal(code_for_host(f.p, "localhost.evil.example:80"), 403);
    assert_int_equal(code_for_host(f.p, "127.0.0.1.evil.example"), 403);
    assert_int_equal(code_of(ask_raw(port_of(f.p), "GET /status HTTP/1.0\r\n\r\n")), 403);
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"buttons\": true}"));
    const char *save = "{\"command\":\"save\"}";
    assert_int_equal(code_of(post(f.p, "Origin: http://evil.example\r\n", save)), 403);
    assert_int_equal(code_of(post(f.p, "Origin: null\r\n", save)), 403);
    assert_int_equal(code_of(post(f.p, "Origin: http://127.0.0.1:1\r\n", save)), 403);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/status", "Origin: http://evil.example\r\n", "")), 403);
    sf_preview_command command;
    assert_false(sf_preview_take_command(f.p, &command));
    snprintf(origin, sizeof origin, "Origin: http://127.0.0.1:%d\r\n", port_of(f.p));
    assert_int_equal(code_of(post(f.p, origin, save)), 204);
    assert_true(sf_preview_take_command(f.p, &command));
    close_one(&f);
}

static void test_hosts(void **state) {
    (void)state;
    assert_true(sf_preview_host_allowed("192.168.1.7:8090", "pi", 0));
    assert_true(sf_preview_host_allowed("[::1]:8090", "pi", 0));
    assert_true(sf_preview_host_allowed("[fe80::1]", "pi", 0));
    assert_true(sf_preview_host_allowed("LOCALHOST", "pi", 0));
    assert_false(sf_preview_host_allowed("pi.local:8090", "pi", 0));
    assert_true(sf_preview_host_allowed("pi.local:8090", "pi", 1));
    assert_true(sf_preview_host_allowed("Pi", "pi.fritz.box", 1));
    assert_false(sf_preview_host_allowed("pie.local", "pi", 1));
    assert_false(sf_preview_host_allowed("x.local", "", 1));
    static const char *const wrong[] = {"",     ":",   ":80",         "[",         "[]",
                                        "[::1", "::1", "[127.0.0.1]", "1.2.3.4:x", "[]:80"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_false(sf_preview_host_allowed(wrong[i], "pi", 0));
    assert_false(sf_preview_host_allowed(NULL, "pi", 0));
    assert_true(sf_preview_token_equal("abcdefgh", "abcdefgh"));
    assert_false(sf_preview_token_equal("abcdefgh", "abcdefg"));
    assert_false(sf_preview_token_equal("abcdefgh", ""));
}

static void test_addresses(void **state) {
    sf_context *ctx = test_context();
    sf_preview_address a;
    (void)state;
    assert_ok(ctx, sf_preview_address_read(ctx, "8091", &a));
    assert_string_equal(a.host, "127.0.0.1");
    assert_true(a.port == 8091 && a.loopback && !a.any);
    assert_ok(ctx, sf_preview_address_read(ctx, "0.0.0.0:0", &a));
    assert_true(a.port == 0 && !a.loopback && a.any && !a.ipv6);
    assert_ok(ctx, sf_preview_address_read(ctx, "[::1]:80", &a));
    assert_string_equal(a.host, "::1");
    assert_true(a.loopback && a.ipv6);
    assert_ok(ctx, sf_preview_address_read(ctx, "[::]:65535", &a));
    assert_true(a.any && !a.loopback);
    static const char *const wrong[] = {
        "",        ":",          "localhost:80",   "127.0.0.1",  "127.0.0.1:",     "127.0.0.1:65536",
        "1.2.3:4", "::1:80",     "[127.0.0.1]:80", "[::1]",      "1.2.3.4:-1",     "x",
        "[::1]80", "0.0.0.0:8a", "[]:1",           "1.2.3.4: 1", "127.0.0.1:8090/"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_status(ctx, sf_preview_address_read(ctx, wrong[i], &a), SF_ERR_ARGUMENT);
        assert_error_names(ctx, "listen");
        assert_error_names(ctx, wrong[i]);
    }
    sf_preview *p;
    sf_preview_options o = {.listen = "127.0.0.1:0", .token = "short"};
    assert_status(ctx, sf_preview_open(ctx, &o, &p), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "token");
    o.token = "a token of spaces";
    assert_status(ctx, sf_preview_open(ctx, &o, &p), SF_ERR_ARGUMENT);
    assert_null(p);
    sf_context_destroy(&ctx);
}

static void test_taken(void **state) {
    fixture f = open_one();
    (void)state;
    char listen[64];
    sf_preview *second;
    snprintf(listen, sizeof listen, "127.0.0.1:%d", port_of(f.p));
    sf_preview_options o = {.listen = listen};
    assert_status(f.ctx, sf_preview_open(f.ctx, &o, &second), SF_ERR_IO);
    assert_null(second);
    assert_error_names(f.ctx, listen);
    assert_error_names(f.ctx, "in use");
    /* Once it is free it can be had at once. */
    sf_preview_close(&f.p);
    assert_ok(f.ctx, sf_preview_open(f.ctx, &o, &f.p));
    assert_int_equal(code_of(get(f.p, "/status")), 200);
    close_one(&f);
}

/* ---- Commands ---- */

static void test_commands(void **state) {
    fixture f = open_one();
    (void)state;
    static const char *const names[] = {"pause", "go-on",         "save",
                                        "reset", "lock-exposure", "unlock-exposure"};
    sf_preview_command command;
    char body[64];
    assert_int_equal(code_of(post(f.p, "", "{\"command\":\"save\"}")), 409); /* no buttons */
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"buttons\": true}"));
    for (int i = 0; i < 16; i++) {
        snprintf(body, sizeof body, "{\"command\": \"%s\"}", names[i % 6]);
        assert_int_equal(code_of(post(f.p, "", body)), 204);
    }
    assert_int_equal(code_of(post(f.p, "", body)), 503);
    for (int i = 0; i < 16; i++) {
        assert_true(sf_preview_take_command(f.p, &command));
        assert_int_equal(command, SF_PREVIEW_PAUSE + i % 6);
    }
    assert_false(sf_preview_take_command(f.p, &command));
    static const char *const wrong[] = {
        "{}", "save", "[]", "{\"command\":1}", "{\"command\":\"Save\"}", "\"save\"", "{\"command\":\"\"}"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(code_of(post(f.p, "", wrong[i])), 400);
    /* What a form of another site could send. */
    assert_int_equal(
        code_of(ask_with(f.p, "POST", "/command", "Content-Type: text/plain\r\nContent-Length: 18\r\n",
                         "{\"command\":\"save\"}")),
        415);
    char much[258];
    memset(much, ' ', 257);
    much[257] = 0;
    assert_int_equal(code_of(post(f.p, "", much)), 413);
    assert_int_equal(code_of(ask_with(f.p, "GET", "/command", "", "")), 405);
    assert_false(sf_preview_take_command(f.p, &command));
    close_one(&f);
}

/* ---- What it withstands ---- */

static void test_garbage(void **state) {
    fixture f = open_one();
    (void)state;
    int port = port_of(f.p);
    static const char *const texts[] = {
        "\r\n\r\n",
        "GET\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "GET /\xff\xfe\x01 HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET /x%00%zz?%%% HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        "POST /command HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
        "POST /command HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        int fd = dial(port);
        send_text(fd, texts[i]);
        shutdown(fd, SHUT_WR);
        answer a = receive_answer(fd);
        assert_true(a.code != 200 && a.code != 204);
        free(a.body);
    }
    /* A head that does not end. */
    char *long_head = malloc(70000);
    assert_non_null(long_head);
    memset(long_head, 'a', 70000);
    memcpy(long_head, "GET / HTTP/1.1\r\nX: ", 19);
    long_head[69999] = 0;
    answer a = ask_raw(port, long_head);
    assert_true(a.code != 200);
    free(a.body);
    free(long_head);
    assert_int_equal(code_of(get(f.p, "/status")), 200);
    close_one(&f);
}

static void *ask_often(void *user) {
    fixture *f = user;
    for (int i = 0; i < 30; i++)
        if (code_of(get(f->p, i % 3 ? "/status" : "/model.splat")) != 200) return user;
    return NULL;
}

/* Three at once, while one never reads, one never writes, and new models come. */
static void test_many(void **state) {
    fixture f = open_one();
    (void)state;
    pthread_t threads[3];
    sf_model *model = some_model(f.ctx, 100000);
    double began = sf_clock();
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    double alone = sf_clock() - began; /* a busy machine is slow at this */
    int deaf = dial(port_of(f.p)), mute = dial(port_of(f.p));
    send_text(deaf, "GET /model.splat HTTP/1.1\r\nHost: localhost\r\n\r\n");
    for (int i = 0; i < 3; i++) assert_int_equal(pthread_create(&threads[i], NULL, ask_often, &f), 0);
    began = sf_clock();
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3)); /* does not wait for who never reads */
    assert_true(sf_clock() - began < 4 + 20 * alone);
    for (int i = 0; i < 3; i++) {
        void *failed;
        pthread_join(threads[i], &failed);
        assert_null(failed);
    }
    close(deaf);
    close(mute);
    sf_model_destroy(&model);
    close_one(&f);
}

/* Clients that neither read nor leave do not keep it from closing. */
static void test_close(void **state) {
    fixture f = open_one();
    (void)state;
    enum { CLIENTS = 12 };
    int fd[CLIENTS];
    sf_model *model = some_model(f.ctx, 200000);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    for (int i = 0; i < CLIENTS; i++) {
        fd[i] = dial(port_of(f.p));
        if (i % 3) send_text(fd[i], "GET /model.splat HTTP/1.1\r\nHost: localhost\r\n\r\n");
    }
    double began = sf_clock();
    sf_preview_close(&f.p);
    assert_true(sf_clock() - began < 20);
    for (int i = 0; i < CLIENTS; i++) close(fd[i]);
    sf_preview_close(&f.p); /* NULL is allowed */
    sf_model_destroy(&model);
    close_one(&f);
}

/* What a call that gets no memory leaves stands, and nothing of it is left over. */
static void test_no_memory(void **state) {
    test_allocations a = {0};
    const sf_allocator counting = {test_count_alloc, test_count_free, &a};
    const sf_context_options options = {.allocator = &counting, .threads = 1};
    const sf_preview_options o = {.listen = "127.0.0.1:0", .token = "abcdefgh"};
    static const uint8_t rgb[12];
    sf_context *ctx;
    sf_preview *p = NULL;
    fixture f = open_one(); /* skips where there is no server */
    (void)state;
    close_one(&f);
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 10, 3, &model));
    long live = atomic_load(&a.live);
    sf_status status = SF_ERR_MEMORY;
    for (long n = 1; status == SF_ERR_MEMORY; n++) {
        a.fail_at = atomic_load(&a.calls) + n;
        status = sf_preview_open(ctx, &o, &p);
        assert_true(status == SF_OK || (!p && atomic_load(&a.live) == live && n < 20));
    }
    assert_status(ctx, status, SF_OK);
    a.fail_at = atomic_load(&a.calls) + 1;
    assert_status(ctx, sf_preview_set_status(p, "{}"), SF_ERR_MEMORY);
    a.fail_at = atomic_load(&a.calls) + 1;
    assert_status(ctx, sf_preview_set_picture(p, SF_PREVIEW_CAMERA, 2, 2, rgb), SF_ERR_MEMORY);
    for (long n = 1; n <= 3; n++) { /* the records, the SH, the order; what was had stays */
        a.fail_at = atomic_load(&a.calls) + (n < 3 ? n : 2);
        assert_status(ctx, sf_preview_set_model(p, model, 3), SF_ERR_MEMORY);
    }
    a.fail_at = 0;
    assert_int_equal(code_of(ask_with(p, "GET", "/model.splat", "Authorization: Bearer abcdefgh\r\n", "")),
                     404);
    assert_ok(ctx, sf_preview_set_picture(p, SF_PREVIEW_CAMERA, 2, 2, rgb));
    a.fail_at = atomic_load(&a.calls) + 1;
    assert_int_equal(code_of(ask_with(p, "GET", "/camera.jpg", "Authorization: Bearer abcdefgh\r\n", "")),
                     503);
    a.fail_at = 0;
    assert_int_equal(code_of(ask_with(p, "GET", "/camera.jpg", "Authorization: Bearer abcdefgh\r\n", "")),
                     200);
    sf_preview_close(&p);
    assert_int_equal(atomic_load(&a.live), live);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    assert_int_equal(atomic_load(&a.live), 0);
}

static void one_round(fixture *f, int i, const uint8_t *rgb, const sf_model *model) {
    static const char *const paths[] = {"/",           "/status?want=crm", "/history",
                                        "/camera.jpg", "/model.splat",     "/nothing"};
    assert_ok(f->ctx, sf_preview_set_picture(f->p, SF_PREVIEW_CAMERA, 64, 48, rgb));
    if (i % 16 == 0) assert_ok(f->ctx, sf_preview_set_model(f->p, model, 3));
    if (i % 4 == 0) set_point(f, i, i % 9);
    int code = code_of(get(f->p, paths[i % 6]));
    assert_int_equal(code, i % 6 == 5 ? 404 : 200);
}

/* Sanitizers keep what was freed, and more. */
#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SANITIZED
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED
#endif
#ifdef SANITIZED
static const uint64_t most = 400000000;
#else
static const uint64_t most = 2000000;
#endif

/* Memory stays put: after the first requests, whose buffers stay, no more is taken. */
static void test_memory(void **state) {
    fixture f = open_one();
    (void)state;
    static uint8_t rgb[64 * 48 * 3];
    sf_model *model = some_model(f.ctx, 3000);
    int rounds = getenv("SPLATFIT_QUICK") ? 100 : getenv("SPLATFIT_FULL") ? 10000 : 1000;
    for (int i = 0; i < rounds / 4; i++) one_round(&f, i, rgb, model);
    uint64_t before = sf_memory_resident();
    for (int i = 0; i < rounds; i++) one_round(&f, i, rgb, model);
    uint64_t after = sf_memory_resident();
    print_message("%d requests: %.1f MB before, %.1f after\n", rounds, (double)before / 1e6,
                  (double)after / 1e6);
    assert_true(after < before + most);
    sf_model_destroy(&model);
    close_one(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page),       cmocka_unit_test(test_status),
        cmocka_unit_test(test_history),    cmocka_unit_test(test_pictures),
        cmocka_unit_test(test_model),      cmocka_unit_test(test_sh),
        cmocka_unit_test(test_wants),      cmocka_unit_test(test_token),
        cmocka_unit_test(test_token_made), cmocka_unit_test(test_host_and_origin),
        cmocka_unit_test(test_hosts),      cmocka_unit_test(test_addresses),
        cmocka_unit_test(test_taken),      cmocka_unit_test(test_commands),
        cmocka_unit_test(test_garbage),    cmocka_unit_test(test_many),
        cmocka_unit_test(test_close),      cmocka_unit_test(test_memory),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
