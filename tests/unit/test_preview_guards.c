/* test_preview_guards.c - the page's server over real sockets: whom it serves, and what it withstands. */
#include "preview_fixture.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/memory.h"
#include "preview/guard.h"
#include "preview/preview.h"

static answer post(const sf_preview *p, const char *headers, const char *body) {
    char all[1024];
    snprintf(all, sizeof all, "Content-Type: application/json\r\nContent-Length: %zu\r\n%s", strlen(body),
             headers);
    return preview_ask_with(p, "POST", "/command", all, body);
}

/* ---- Who may ---- */

static void test_token(void **state) {
    fixture f = preview_open_with("127.0.0.1:0", "a-Token_of-tests");
    (void)state;
    assert_non_null(strstr(sf_preview_url(f.p), "/?token=a-Token_of-tests"));
    static const char *const all[] = {"/", "/status", "/history", "/camera.jpg", "/model.splat", "/nothing"};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        answer a = preview_get(f.p, all[i]);
        assert_int_equal(a.code, 403);
        assert_ptr_equal(strchr((char *)a.body, '\n'), (char *)a.body + a.size - 1); /* one line */
        free(a.body);
    }
    assert_int_equal(preview_code_of(preview_get(f.p, "/?token=")), 403);
    assert_int_equal(preview_code_of(preview_get(f.p, "/?token=a-Token_of-test")), 403);
    assert_int_equal(preview_code_of(preview_get(f.p, "/?token=a-Token_of-testsX")), 403);
    assert_int_equal(preview_code_of(preview_get(f.p, "/?token=a-token_of-tests")), 403);
    assert_int_equal(preview_code_of(post(f.p, "", "{\"command\":\"save\"}")), 403);
    answer a = preview_get(f.p, "/?token=a-Token_of-tests");
    assert_int_equal(a.code, 200);
    char cookie[256], headers[512];
    preview_header_value(&a, "Set-Cookie: ", cookie, sizeof cookie);
    assert_non_null(strstr(cookie, "HttpOnly"));
    assert_non_null(strstr(cookie, "SameSite=Strict"));
    free(a.body);
    snprintf(headers, sizeof headers, "Cookie: other=1; %.*s\r\n", (int)strcspn(cookie, ";"), cookie);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/status", headers, "")), 200);
    headers[strlen(headers) - 3] ^= 1;
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/status", headers, "")), 403);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/status",
                                                      "Authorization: Bearer a-Token_of-tests\r\n", "")),
                     200);
    assert_int_equal(
        preview_code_of(preview_ask_with(f.p, "GET", "/status", "Authorization: Bearer x\r\n", "")), 403);
    preview_close_one(&f);
}

static void test_token_made(void **state) {
    fixture f = preview_open_with("0.0.0.0:0", NULL);
    (void)state;
    const char *token = strstr(sf_preview_url(f.p), "?token=");
    assert_non_null(token); /* never beyond this machine without */
    assert_int_equal(strlen(token + 7), 32);
    assert_null(strstr(sf_preview_url(f.p), "0.0.0.0"));
    char path[64], other[33];
    snprintf(other, sizeof other, "%s", token + 7);
    assert_int_equal(preview_code_of(preview_get(f.p, "/status")), 403);
    snprintf(path, sizeof path, "/status%s", token);
    assert_int_equal(preview_code_of(preview_get(f.p, path)), 200);
    preview_close_one(&f);
    f = preview_open_with("0.0.0.0:0", NULL);
    assert_null(strstr(sf_preview_url(f.p), other));
    preview_close_one(&f);
}

static int code_for_host(const sf_preview *p, const char *host) {
    char request[512];
    snprintf(request, sizeof request, "GET /status HTTP/1.1\r\nHost: %s\r\n\r\n", host);
    return preview_code_of(preview_ask_raw(preview_port_of(p), request));
}

static void test_host_and_origin(void **state) {
    fixture f = preview_open_one();
    (void)state;
    char origin[128];
    assert_int_equal(code_for_host(f.p, "localhost:8090"), 200);
    assert_int_equal(code_for_host(f.p, "127.0.0.1"), 200);
    assert_int_equal(code_for_host(f.p, "evil.example"), 403);
    assert_int_equal(code_for_host(f.p, "localhost.evil.example:80"), 403);
    assert_int_equal(code_for_host(f.p, "127.0.0.1.evil.example"), 403);
    assert_int_equal(preview_code_of(preview_ask_raw(preview_port_of(f.p), "GET /status HTTP/1.0\r\n\r\n")),
                     403);
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"buttons\": true}"));
    const char *save = "{\"command\":\"save\"}";
    assert_int_equal(preview_code_of(post(f.p, "Origin: http://evil.example\r\n", save)), 403);
    assert_int_equal(preview_code_of(post(f.p, "Origin: null\r\n", save)), 403);
    assert_int_equal(preview_code_of(post(f.p, "Origin: http://127.0.0.1:1\r\n", save)), 403);
    assert_int_equal(
        preview_code_of(preview_ask_with(f.p, "GET", "/status", "Origin: http://evil.example\r\n", "")), 403);
    sf_preview_command command;
    assert_false(sf_preview_take_command(f.p, &command));
    snprintf(origin, sizeof origin, "Origin: http://127.0.0.1:%d\r\n", preview_port_of(f.p));
    assert_int_equal(preview_code_of(post(f.p, origin, save)), 204);
    assert_true(sf_preview_take_command(f.p, &command));
    preview_close_one(&f);
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
    fixture f = preview_open_one();
    (void)state;
    char listen[64];
    sf_preview *second;
    snprintf(listen, sizeof listen, "127.0.0.1:%d", preview_port_of(f.p));
    sf_preview_options o = {.listen = listen};
    assert_status(f.ctx, sf_preview_open(f.ctx, &o, &second), SF_ERR_IO);
    assert_null(second);
    assert_error_names(f.ctx, listen);
    assert_error_names(f.ctx, "in use");
    /* Once it is free it can be had at once. */
    sf_preview_close(&f.p);
    assert_ok(f.ctx, sf_preview_open(f.ctx, &o, &f.p));
    assert_int_equal(preview_code_of(preview_get(f.p, "/status")), 200);
    preview_close_one(&f);
}

/* ---- Commands ---- */

static void test_commands(void **state) {
    fixture f = preview_open_one();
    (void)state;
    static const char *const names[] = {"pause", "go-on",         "save",
                                        "reset", "lock-exposure", "unlock-exposure"};
    sf_preview_command command;
    char body[64];
    assert_int_equal(preview_code_of(post(f.p, "", "{\"command\":\"save\"}")), 409); /* no buttons */
    assert_ok(f.ctx, sf_preview_set_status(f.p, "{\"buttons\": true}"));
    for (int i = 0; i < 16; i++) {
        snprintf(body, sizeof body, "{\"command\": \"%s\"}", names[i % 6]);
        assert_int_equal(preview_code_of(post(f.p, "", body)), 204);
    }
    assert_int_equal(preview_code_of(post(f.p, "", body)), 503);
    for (int i = 0; i < 16; i++) {
        assert_true(sf_preview_take_command(f.p, &command));
        assert_int_equal(command, SF_PREVIEW_PAUSE + i % 6);
    }
    assert_false(sf_preview_take_command(f.p, &command));
    static const char *const wrong[] = {
        "{}", "save", "[]", "{\"command\":1}", "{\"command\":\"Save\"}", "\"save\"", "{\"command\":\"\"}"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(preview_code_of(post(f.p, "", wrong[i])), 400);
    /* What a form of another site could send. */
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "POST", "/command",
                                                      "Content-Type: text/plain\r\nContent-Length: 18\r\n",
                                                      "{\"command\":\"save\"}")),
                     415);
    char much[258];
    memset(much, ' ', 257);
    much[257] = 0;
    assert_int_equal(preview_code_of(post(f.p, "", much)), 413);
    assert_int_equal(preview_code_of(preview_ask_with(f.p, "GET", "/command", "", "")), 405);
    assert_false(sf_preview_take_command(f.p, &command));
    preview_close_one(&f);
}

/* ---- What it withstands ---- */

static void test_garbage(void **state) {
    fixture f = preview_open_one();
    (void)state;
    int port = preview_port_of(f.p);
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
        int fd = preview_dial(port);
        preview_send_text(fd, texts[i]);
        shutdown(fd, SHUT_WR);
        answer a = preview_receive_answer(fd);
        assert_true(a.code != 200 && a.code != 204);
        free(a.body);
    }
    /* A head that does not end. */
    char *long_head = malloc(70000);
    assert_non_null(long_head);
    memset(long_head, 'a', 70000);
    memcpy(long_head, "GET / HTTP/1.1\r\nX: ", 19);
    long_head[69999] = 0;
    answer a = preview_ask_raw(port, long_head);
    assert_true(a.code != 200);
    free(a.body);
    free(long_head);
    assert_int_equal(preview_code_of(preview_get(f.p, "/status")), 200);
    preview_close_one(&f);
}

static void *ask_often(void *user) {
    fixture *f = user;
    for (int i = 0; i < 30; i++)
        if (preview_code_of(preview_get(f->p, i % 3 ? "/status" : "/model.splat")) != 200) return user;
    return NULL;
}

/* Three at once, while one never reads, one never writes, and new models come. */
static void test_many(void **state) {
    fixture f = preview_open_one();
    (void)state;
    pthread_t threads[3];
    sf_model *model = preview_some_model(f.ctx, 100000);
    double began = sf_clock();
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    double alone = sf_clock() - began; /* a busy machine is slow at this */
    int deaf = preview_dial(preview_port_of(f.p)), mute = preview_dial(preview_port_of(f.p));
    preview_send_text(deaf, "GET /model.splat HTTP/1.1\r\nHost: localhost\r\n\r\n");
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
    preview_close_one(&f);
}

/* Clients that neither read nor leave do not keep it from closing. */
static void test_close(void **state) {
    fixture f = preview_open_one();
    (void)state;
    enum { CLIENTS = 12 };
    int fd[CLIENTS];
    sf_model *model = preview_some_model(f.ctx, 200000);
    assert_ok(f.ctx, sf_preview_set_model(f.p, model, 3));
    for (int i = 0; i < CLIENTS; i++) {
        fd[i] = preview_dial(preview_port_of(f.p));
        if (i % 3) preview_send_text(fd[i], "GET /model.splat HTTP/1.1\r\nHost: localhost\r\n\r\n");
    }
    double began = sf_clock();
    sf_preview_close(&f.p);
    assert_true(sf_clock() - began < 20);
    for (int i = 0; i < CLIENTS; i++) close(fd[i]);
    sf_preview_close(&f.p); /* NULL is allowed */
    sf_model_destroy(&model);
    preview_close_one(&f);
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
    fixture f = preview_open_one(); /* skips where there is no server */
    (void)state;
    preview_close_one(&f);
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
    assert_int_equal(
        preview_code_of(preview_ask_with(p, "GET", "/model.splat", "Authorization: Bearer abcdefgh\r\n", "")),
        404);
    assert_ok(ctx, sf_preview_set_picture(p, SF_PREVIEW_CAMERA, 2, 2, rgb));
    a.fail_at = atomic_load(&a.calls) + 1;
    assert_int_equal(
        preview_code_of(preview_ask_with(p, "GET", "/camera.jpg", "Authorization: Bearer abcdefgh\r\n", "")),
        503);
    a.fail_at = 0;
    assert_int_equal(
        preview_code_of(preview_ask_with(p, "GET", "/camera.jpg", "Authorization: Bearer abcdefgh\r\n", "")),
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
    if (i % 4 == 0) preview_set_point(f, i, i % 9);
    int code = preview_code_of(preview_get(f->p, paths[i % 6]));
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
    fixture f = preview_open_one();
    (void)state;
    static uint8_t rgb[64 * 48 * 3];
    sf_model *model = preview_some_model(f.ctx, 3000);
    int rounds = getenv("SPLATFIT_QUICK") ? 100 : getenv("SPLATFIT_FULL") ? 10000 : 1000;
    for (int i = 0; i < rounds / 4; i++) one_round(&f, i, rgb, model);
    uint64_t before = sf_memory_resident();
    for (int i = 0; i < rounds; i++) one_round(&f, i, rgb, model);
    uint64_t after = sf_memory_resident();
    print_message("%d requests: %.1f MB before, %.1f after\n", rounds, (double)before / 1e6,
                  (double)after / 1e6);
    assert_true(after < before + most);
    sf_model_destroy(&model);
    preview_close_one(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_token),
        cmocka_unit_test(test_token_made),
        cmocka_unit_test(test_host_and_origin),
        cmocka_unit_test(test_hosts),
        cmocka_unit_test(test_addresses),
        cmocka_unit_test(test_taken),
        cmocka_unit_test(test_commands),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_many),
        cmocka_unit_test(test_close),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
