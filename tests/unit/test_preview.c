/* test_preview.c - the page's server over real sockets: what it serves. */
#include "preview_fixture.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "io/picture.h"
#include "preview/preview.h"

static json_t *get_json(const sf_preview *p, const char *path) {
    answer a = preview_get(p, path);
    assert_int_equal(a.code, 200);
    json_t *json = json_loadb((char *)a.body, a.size, 0, NULL);
    assert_non_null(json);
    free(a.body);
    return json;
}

static void test_page(void **state) {
    fixture f = preview_open_one();
    (void)state;
    assert_null(strstr(sf_preview_url(f.p), "token"));
    answer a = preview_get(f.p, "/");
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
    a = preview_ask_with(f.p, "HEAD", "/", "", "");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, 0);
    free(a.body);
    assert_int_equal(preview_code_of(preview_get(f.p, "/etc/passwd")), 404);
    assert_int_equal(preview_code_of(preview_get(f.p, "/../../etc/passwd")), 404);
    assert_int_equal(preview_code_of(preview_get(f.p, "/%2e%2e/%2e%2e/etc/passwd")), 404);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "PUT", "/", "Content-Length: 0\r\n", "")), 405);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "DELETE", "/page.html", "", "")), 405);
    assert_int_equal(preview_code_of(preview_get(f.p, "/command")), 405);
    preview_close_one(&f);
}

static void test_status(void **state) {
    fixture f = preview_open_one();
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
    preview_close_one(&f);
}

static void test_history(void **state) {
    fixture f = preview_open_one();
    (void)state;
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"seconds\": 0}"));
    preview_set_point(&f, 1, 20);
    preview_set_point(&f, 2, 20);
    preview_set_point(&f, 3, 21);
    json_t *json = get_json(f.p, "/history"), *points = json_object_get(json, "points");
    assert_int_equal(json_array_size(points), 2);
    const json_t *second = json_array_get(points, 1);
    assert_float_equal(json_number_value(json_array_get(second, 0)), 3, 1e-9);
    assert_float_equal(json_number_value(json_array_get(second, 1)), 21, 1e-9);
    assert_true(json_is_null(json_array_get(second, 2)));
    json_decref(json);
    /* A long run stays in its bounds, from its first point to its last. */
    for (int i = 0; i < 5000; i++) preview_set_point(&f, 4 + i, 20 + i % 7);
    json = get_json(f.p, "/history");
    points = json_object_get(json, "points");
    size_t n = json_array_size(points);
    assert_between(n, 512, 1024);
    assert_float_equal(json_number_value(json_array_get(json_array_get(points, 0), 0)), 1, 1e-9);
    assert_float_equal(json_number_value(json_array_get(json_array_get(points, n - 1), 0)), 5003, 1e-9);
    json_decref(json);
    preview_set_point(&f, 0, 5); /* begun anew */
    json = get_json(f.p, "/history");
    assert_int_equal(json_array_size(json_object_get(json, "points")), 1);
    json_decref(json);
    preview_close_one(&f);
}

static void test_pictures(void **state) {
    enum { W = 40, H = 24 };
    fixture f = preview_open_one();
    static uint8_t rgb[W * H * 3];
    (void)state;
    assert_int_equal(preview_code_of(preview_get(f.p, "/camera.jpg")), 404);
    for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = i % 3 == 0 ? 200 : i % 3 == 1 ? 100 : 30;
    assert_ok(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W, H, rgb));
    assert_int_equal(preview_code_of(preview_get(f.p, "/render.jpg")), 404);
    answer a = preview_get(f.p, "/camera.jpg");
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
    preview_header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(known, sizeof known, "If-None-Match: %s\r\n", tag);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/camera.jpg", known, "")), 304);
    assert_ok(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W / 2, H, rgb));
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/camera.jpg", known, "")), 200);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_MODEL, W, H, rgb), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, 0, H, rgb), SF_ERR_ARGUMENT);
    assert_status(f.ctx, sf_preview_set_picture(f.p, SF_PREVIEW_CAMERA, W, 16385, rgb), SF_ERR_ARGUMENT);
    preview_close_one(&f);
}

static void test_model(void **state) {
    enum { COUNT = 5000 };
    fixture f = preview_open_one();
    (void)state;
    assert_int_equal(preview_code_of(preview_get(f.p, "/model.splat")), 404);
    sf_model *model = preview_some_model(f.ctx, COUNT);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    assert_ok(f.ctx, sf_model_save(model, test_path("model.splat")));
    size_t size;
    uint8_t *file = test_read(test_path("model.splat"), &size);
    answer a = preview_get(f.p, "/model.splat");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, size);
    assert_memory_equal(a.body, file, size);
    free(a.body);
    /* In parts, of one version. */
    char tag[128], headers[512];
    preview_header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(headers, sizeof headers, "If-None-Match: %s\r\n", tag);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/model.splat", headers, "")), 304);
    snprintf(headers, sizeof headers, "If-Match: %s\r\nRange: bytes=100-4195\r\n", tag);
    for (int publishes = 0; publishes < 3; publishes++) {
        a = preview_ask_with(f.p, "GET", "/model.splat", headers, "");
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
    assert_int_equal(
        preview_code_of(preview_ask_with(f.p, "GET", "/model.splat", "Range: bytes=160000-\r\n", "")), 416);
    a = preview_ask_with(f.p, "GET", "/model.splat", "Range: bytes=159990-999999999999999999999\r\n", "");
    assert_int_equal(a.code, 206);
    assert_int_equal(a.size, 10);
    free(a.body);
    static const char *const odd[] = {"bytes=-5", "bytes=5-4", "bytes=a-b", "bytes=1-2,5-6", "lines=1-2"};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        snprintf(headers, sizeof headers, "Range: %s\r\n", odd[i]);
        int code = preview_code_of(preview_ask_with(f.p, "GET", "/model.splat", headers, ""));
        assert_true(code == 200 || code == 416);
    }
    sf_model_destroy(&model);
    /* A model of nothing is one. */
    model = preview_some_model(f.ctx, 0);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    a = preview_get(f.p, "/model.splat");
    assert_int_equal(a.code, 200);
    assert_int_equal(a.size, 0);
    free(a.body);
    sf_model_destroy(&model);
    free(file);
    preview_close_one(&f);
}

/* What a .splat leaves out, in its order: the heaviest Gaussian, which is the second, comes first. */
static void test_sh(void **state) {
    fixture f = preview_open_one();
    sf_model *model;
    (void)state;
    assert_int_equal(preview_code_of(preview_get(f.p, "/model.sh")), 404);
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
        answer a = preview_get(f.p, "/model.sh");
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
    answer a = preview_ask_with(f.p, "GET", "/model.sh", "Range: bytes=90-\r\n", "");
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
    preview_close_one(&f);
}

static void test_wants(void **state) {
    fixture f = preview_open_one();
    (void)state;
    const int all = SF_PREVIEW_CAMERA | SF_PREVIEW_RENDER | SF_PREVIEW_MODEL | SF_PREVIEW_STATUS;
    assert_false(sf_preview_wants(f.p, all));
    assert_int_equal(preview_code_of(preview_get(f.p, "/status?want=cm")), 200);
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_CAMERA));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_STATUS));
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_RENDER | SF_PREVIEW_CAMERA));
    assert_false(sf_preview_wants(f.p, SF_PREVIEW_RENDER));
    /* Who is in the middle of an older model holds up the next. */
    sf_model *model = preview_some_model(f.ctx, 100);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    answer a = preview_ask_with(f.p, "GET", "/model.splat", "Range: bytes=0-31\r\n", "");
    free(a.body);
    assert_true(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    char tag[128], headers[256];
    preview_header_value(&a, "ETag: ", tag, sizeof tag);
    snprintf(headers, sizeof headers, "If-Match: %s\r\nRange: bytes=32-63\r\n", tag);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/model.splat", headers, "")), 206);
    assert_false(sf_preview_wants(f.p, SF_PREVIEW_MODEL));
    sf_model_destroy(&model);
    preview_close_one(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page),     cmocka_unit_test(test_status), cmocka_unit_test(test_history),
        cmocka_unit_test(test_pictures), cmocka_unit_test(test_model),  cmocka_unit_test(test_sh),
        cmocka_unit_test(test_wants),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
