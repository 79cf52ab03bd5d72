/* test_outputs_page.c - the program from outside: the page of splatfit view. */
#include "program.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { BLOBS = 7 };

/* Blobs in a row. */
static int set_up(void **state) {
    static float means[3 * BLOBS], logits[BLOBS];
    if (program_set_up(state)) return 1;
    sf_context *ctx = test_context();
    sf_model *model;
    for (size_t i = 0; i < BLOBS; i++) means[3 * i] = (float)i, logits[i] = 3;
    const sf_gaussians g = {.means = means, .logit_opacities = logits};
    assert_ok(ctx, sf_model_create(ctx, BLOBS, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, BLOBS, &g));
    assert_ok(ctx, sf_model_save(model, work("blobs.ply")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return 0;
}

/* The address that it says, once it does; 0: it ended before. */
static int wait_for_page(pid_t pid, int *port, int *status) {
    double since = now();
    for (;;) {
        int ended = has_ended(pid, since, status);
        outcome o = take_outcome(0);
        int there = sscanf(o.out, "page: http://127.0.0.1:%d/", port) == 1 && strchr(o.out, '\n');
        free_outcome(&o);
        if (there && !ended) return 1;
        if (ended) return 0;
        test_pause_ms(20);
    }
}

/* What the page gives, with its head; free() it. */
static char *fetch(int port, const char *path) {
    enum { ROOM = 1 << 17 };
    char *text = calloc(ROOM, 1), request[256];
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int fd = socket(AF_INET, SOCK_STREAM, 0), n;
    size_t used = 0;
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    assert_non_null(text);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    n = snprintf(request, sizeof request, "GET %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n", path, port);
    assert_int_equal(send(fd, request, (size_t)n, MSG_NOSIGNAL), n);
    for (ssize_t got; used < ROOM - 1 && (got = recv(fd, text + used, ROOM - 1 - used, 0)) > 0;)
        used += (size_t)got;
    close(fd);
    return text;
}

/* splatfit view, whose page is then at `port`. */
static pid_t open_page(const char *const *arguments, int *port) {
    pid_t pid = start_program(arguments, NULL);
    int ended = 0;
    if (wait_for_page(pid, port, &ended)) return pid;
    outcome o = take_outcome(ended);
    int unbuilt = strstr(o.err, "not built with civetweb") != NULL;
    if (!unbuilt) fail_msg("%s", o.err);
    assert_int_equal(o.code, FAILED);
    free_outcome(&o);
    test_skip("not built with civetweb");
    return 0;
}

static void close_page(pid_t pid) {
    assert_int_equal(kill(pid, SIGINT), 0);
    outcome o = wait_for(pid);
    assert_int_equal(o.code, 0);
    assert_int_equal(o.signal, 0);
    free_outcome(&o);
}

/* What the program told the page; json_decref it. */
static json_t *fetch_status(int port) {
    char *status = fetch(port, "/status?want=m");
    assert_non_null(strstr(status, "200 OK"));
    json_t *all = json_loads(strstr(status, "\r\n\r\n") + 4, 0, NULL), *told = json_object_get(all, "status");
    assert_true(json_is_true(json_object_get(told, "still")));
    json_incref(told);
    json_decref(all);
    free(status);
    return told;
}

static void test_page(void **state) {
    int port = 0;
    (void)state;
    clear_out();
    run_quietly(ARGS("render", "blobs.ply", SCENE, "--out", "out", "-q"));
    pid_t pid = open_page(ARGS("view", "blobs.ply", "--listen", "127.0.0.1:0", "--cameras",
                               "out/cameras.json", "--background", "white"),
                          &port);
    json_t *told = fetch_status(port);
    assert_int_equal(test_number(told, "gaussians"), BLOBS);
    assert_null(json_object_get(told, "contents"));
    assert_int_equal(json_array_size(json_object_get(told, "views")), SCENE_VIEWS);
    assert_true(json_number_value(json_array_get(json_object_get(told, "background"), 2)) == 1);
    json_decref(told);
    char *command = fetch(port, "/command");
    assert_non_null(strstr(command, "405"));
    free(command);
    char *bytes = fetch(port, "/model.splat");
    assert_non_null(strstr(bytes, "Content-Length: 224\r\n")); /* 32 each */
    free(bytes);
    close_page(pid);
}

/* A project: each camera ten lines of six Gaussians, seen from farther away than any camera is. */
static void test_project_page(void **state) {
    int port = 0;
    (void)state;
    pid_t pid = open_page(ARGS("view", SCENE, "--hold-out", "3", "--listen", "127.0.0.1:0"), &port);
    json_t *told = fetch_status(port), *views = json_object_get(told, "views");
    int held_out = (SCENE_VIEWS + 2) / 3, points = -1, cameras = 0, out = 0;
    const char *contents = json_string_value(json_object_get(told, "contents"));
    assert_int_equal(
        sscanf(contents, "%d sparse points, %d cameras, %d of them held out", &points, &cameras, &out), 3);
    assert_int_equal(cameras, SCENE_VIEWS);
    assert_int_equal(out, held_out);
    assert_int_equal(test_number(told, "gaussians"), points + 60 * SCENE_VIEWS);
    assert_int_equal(json_array_size(views), SCENE_VIEWS);
    const json_t *t = json_object_get(json_object_get(told, "pose"), "t_cw");
    double depth = json_number_value(json_array_get(t, 2));
    for (size_t i = 0; i < SCENE_VIEWS; i++)
        assert_true(json_number_value(json_array_get(json_object_get(json_array_get(views, i), "t_cw"), 2)) <
                    depth);
    json_decref(told);
    close_page(pid);
}

static void test_pages_are_refused(void **state) {
    (void)state;
    clear_out();
    write_text("bad.json", "{}");
    outcome o = run("view", "blobs.ply", "--listen", "here");
    int unbuilt = strstr(o.err, "not built with civetweb") != NULL;
    free_outcome(&o);
    if (unbuilt) test_skip("not built with civetweb");
    static const bad_input cases[] = {
        {FAILED, "\"here\" is not ADDRESS:PORT", {"view", "blobs.ply", "--listen", "here"}},
        {FAILED,
         "token: it must be of 8 to 64",
         {"view", "blobs.ply", "--listen", "127.0.0.1:0", "--token", "a"}},
        {FAILED, "absent.ply: ", {"view", "absent.ply"}},
        {FAILED, "absent: ", {"view", "absent"}},
        {USAGE, "--images: goes with a project, not with blobs.ply", {"view", "blobs.ply", "--images", "a"}},
        {USAGE, "--cameras: goes with a model, not with " SCENE, {"view", SCENE, "--cameras", "bad.json"}},
        {FAILED,
         "bad.json: is not an array of cameras",
         {"view", "blobs.ply", "--listen", "127.0.0.1:0", "--cameras", "bad.json"}},
        {USAGE, "--up: \"u\" is none", {"view", "blobs.ply", "--listen", "127.0.0.1:0", "--up", "u"}},
        {USAGE,
         "--background: \"red\" is neither",
         {"view", "blobs.ply", "--listen", "127.0.0.1:0", "--background", "red"}},
    };
    assert_all_refused(cases, COUNT(cases));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page),
        cmocka_unit_test(test_project_page),
        cmocka_unit_test(test_pages_are_refused),
    };
    return cmocka_run_group_tests_name("outputs_page", tests, set_up, NULL);
}
