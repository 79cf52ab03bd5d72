/* test_path.c - poses from outside: lines, files, sockets, and poses between two. */
#include "../testing.h"

#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "../../src/base/clock.h"
#include "../../src/pose/path.h"

#include <splatfit/path.h>

static const int64_t second = 1000000000;

/* "file:<scratch folder>/<file><options>" with that content. */
static const char *file_name(const char *file, const char *text, const char *options) {
    static char name[512];
    test_write(test_path(file), text, strlen(text));
    snprintf(name, sizeof name, "file:%s%s", test_path(file), options);
    return name;
}

static sf_path *open_path(sf_context *ctx, const char *name) {
    sf_path *path;
    assert_ok(ctx, sf_path_open(ctx, name, &path));
    return path;
}

/* The camera's centre in the world. */
static void center_of(const double R[9], const double t[3], double c[3]) {
    for (int i = 0; i < 3; i++) c[i] = -(R[i] * t[0] + R[3 + i] * t[1] + R[6 + i] * t[2]);
}

static void assert_near(const double *a, const double *b, int n, double tolerance) {
    for (int i = 0; i < n; i++) assert_true(fabs(a[i] - b[i]) <= tolerance);
}

/* A turn about z of 90 degrees in a second, on a straight line: in between as closed forms have it. */
static void test_between(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *text = "# timestamp tx ty tz qx qy qz qw\n"
                       "\n"
                       "100.0 1 2 3 0 0 0 1\r\n"
                       "101.0,2,0,3.5,0,0,0.70710678,0.70710678 # a comment\n"
                       "102\t2 0 3.5  0 0 -0.70710678 -0.70710678";
    sf_path *path = open_path(ctx, file_name("line.txt", text, "?gap=1"));
    for (int i = 0; i <= 20; i++) {
        double t = fmin(i / 10.0, 1), angle = t * 3.14159265358979 / 2, R[9], v[3], center[3];
        const double expected[9] = {cos(angle), sin(angle), 0, -sin(angle), cos(angle), 0, 0, 0, 1};
        const double place[3] = {1 + t, 2 - 2 * t, 3 + 0.5 * t};
        assert_ok(ctx, sf_path_at(path, 100 * second + i * second / 10, R, v));
        center_of(R, v, center);
        assert_near(R, expected, 9, 1e-8); /* also where the quaternion's sign changed */
        assert_near(center, place, 3, 1e-8);
    }
    sf_path_info info;
    sf_path_describe(path, &info);
    assert_int_equal(info.poses, 3);
    assert_int_equal(info.live, 0);
    assert_true(info.first_ns == 100 * second && info.last_ns == 102 * second);
    sf_path_close(&path);
    assert_null(path);
    sf_path_close(&path);
    sf_context_destroy(&ctx);
}

/* A time is known to the nanosecond's neighbourhood, at the size of those since 1970 too. */
static void test_gaps_and_ends(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *text = "1305031102.1 0 0 0 0 0 0 1\n1305031102.25 1 0 0 0 0 0 1\n1305031102.5 2 0 0 0 0 0 1\n"
                       "1305031102.5 9 0 0 0 0 0 1\n";
    sf_path *path = open_path(ctx, file_name("gaps.txt", text, "?offset=-1305031100"));
    const struct {
        double at;
        const char *why;
    } none[] = {{2.0999, "before the first"}, {2.26, "gap"}, {2.4999, "gap"}, {2.5001, "after the last"}};
    double R[9], t[3];
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        assert_status(ctx, sf_path_at(path, (int64_t)(none[i].at * 1e9), R, t), SF_ERR_EMPTY);
        assert_error_names(ctx, none[i].why);
        assert_error_names(ctx, "gaps.txt");
    }
    assert_ok(ctx, sf_path_at(path, (int64_t)(2.175 * 1e9), R, t));
    assert_true(fabs(t[0] + 0.5) < 1e-4);
    sf_path_info info;
    sf_path_describe(path, &info);
    assert_true(llabs(info.last_ns - 5 * second / 2) < 1000);
    assert_int_equal(info.repeated, 1);
    assert_ok(ctx, sf_path_wait(path, 2 * second, 0));
    assert_status(ctx, sf_path_wait(path, 3 * second, 1000), SF_ERR_EMPTY); /* at once */
    sf_path_close(&path);
    path = open_path(ctx, file_name("gaps.txt", text, "?gap=0.3&offset=-1305031100"));
    assert_ok(ctx, sf_path_at(path, (int64_t)(2.375 * 1e9), R, t));
    assert_true(fabs(t[0] + 1.5) < 1e-4);
    sf_path_close(&path);
    sf_context_destroy(&ctx);
}

/* A camera that looks sideways from a robot: x forward, y left, z up. */
static void test_rig(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_path *path = open_path(ctx, file_name("rig.txt", "0 10 0 0 0 0 0.70710678 0.70710678\n",
                                             "?rig=0.1,0,0.5,-0.5,0.5,-0.5,0.5"));
    double R[9], t[3], center[3];
    assert_ok(ctx, sf_path_at(path, 0, R, t));
    center_of(R, t, center);
    const double place[3] = {10, 0.1, 0.5}; /* the robot faces +y */
    const double rows[9] = {1, 0, 0, 0, 0, -1, 0, 1, 0};
    assert_near(center, place, 3, 1e-8);
    assert_near(R, rows, 9, 1e-8);
    sf_path_close(&path);
    sf_context_destroy(&ctx);
}

static void test_bad_files(void **state) {
    (void)state;
    static const struct {
        const char *text, *part;
    } bad[] = {
        {"1 2 3 4 0 0 0 1\n2 2 3 4 0 0 0\n", "bad.txt: line 2: qw: is missing"},
        {"# x\n1 2 3 4 0 0 abc 1\n", "bad.txt: line 2: qz: \"abc\" is not a number"},
        {"1 2 nan 4 0 0 0 1\n", "line 1: ty: \"nan\" is not a number"},
        {"0x1 2 3 4 0 0 0 1\n", "line 1: time: \"0x1\" is not a number"},
        {"1 2 3 1e13 0 0 0 1\n", "line 1: tz: \"1e13\" is out of range"},
        {"1e300 2 3 1 0 0 0 1\n", "line 1: time: \"1e300\" is out of range"},
        {"1 2 3 1e999 0 0 0 1\n", "line 1: tz: \"1e999\" is out of range"},
        {"1 2 3 4 0 0 0 0.5\n", "line 1: qx qy qz qw: the quaternion's length 0.5 is not 1"},
        {"1 2 3 4 0 0 0 1 7\n", "line 1: \"7\": is more than the 8 fields"},
        {"1 2 3 4 0 0 0 1\n0.5 2 3 4 0 0 0 1\n", "line 2: time: 0.5 s: is before that of the pose before"},
    };
    sf_context *ctx = test_context();
    sf_path *path;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_status(ctx, sf_path_open(ctx, file_name("bad.txt", bad[i].text, ""), &path), SF_ERR_FORMAT);
        assert_error_names(ctx, bad[i].part);
        assert_null(path);
    }
    assert_status(ctx, sf_path_open(ctx, file_name("bad.txt", "# nothing\n", ""), &path), SF_ERR_EMPTY);
    test_write(test_path("zero.txt"), "1 2 3 4 0\0 0 0 1\n", 17);
    char name[512];
    snprintf(name, sizeof name, "file:%s", test_path("zero.txt"));
    assert_status(ctx, sf_path_open(ctx, name, &path), SF_ERR_FORMAT);
    assert_error_names(ctx, "zero.txt: line 1: holds a 0");
    assert_status(ctx, sf_path_open(ctx, "file:no/such.txt", &path), SF_ERR_IO);
    assert_error_names(ctx, "no/such.txt");
    sf_context_destroy(&ctx);
}

static void test_bad_names(void **state) {
    (void)state;
    static const struct {
        const char *name, *part;
    } bad[] = {{"poses.txt", "known: file: unix: udp:"},
               {"http:x", "known: file:"},
               {"x?a=file:b", "known: file:"},
               {"udp:127.0.0.1", "ADDRESS:PORT"},
               {"udp:127.0.0.1:70000", "ADDRESS:PORT"},
               {"udp:127.0.0.1:12x", "ADDRESS:PORT"},
               {"udp:robot:5555", "\"robot\" is not an IPv4 address"},
               {"unix:", "a socket's path"},
               {"file:x?gap=-1", "gap: -1"},
               {"file:x?speed=1", "unknown option \"speed\""},
               {"file:x?clock=unix", "clock: unix is for poses that arrive"},
               {"udp:127.0.0.1:0?clock=sun", "clock: \"sun\""},
               {"udp:127.0.0.1:0?rig=1,2,3", "rig: qx: is missing"}};
    sf_context *ctx = test_context();
    sf_path *path;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_status(ctx, sf_path_open(ctx, bad[i].name, &path), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_null(path);
    }
    sf_context_destroy(&ctx);
}

static void send_text(int fd, const char *text) {
    assert_int_equal(send(fd, text, strlen(text), 0), strlen(text));
}

/* Waits until so many lines were taken or left out. */
static sf_path_info wait_for(sf_path *path, uint64_t lines) {
    sf_path_info info;
    for (int i = 0; i < 2000; i++) {
        sf_path_describe(path, &info);
        if (info.poses + info.malformed + info.repeated + info.late >= lines) return info;
        test_pause_ms(5);
    }
    fail_msg("only %d poses came", (int)info.poses);
    return info;
}

static int connect_to(const char *place) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", place);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&address, sizeof address), 0);
    return fd;
}

/* A stream, in pieces that cut lines; a second sender; lines that are wrong, late, doubled, too long. */
static void test_stream(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    char name[512], place[256], noise[700];
    snprintf(place, sizeof place, "%s", test_path("robot.sock"));
    snprintf(name, sizeof name, "unix:%s?gap=10&offset=5", place);
    sf_path *path = open_path(ctx, name), *second_path;
    double R[9], t[3];
    assert_status(ctx, sf_path_at(path, 0, R, t), SF_ERR_EMPTY);
    assert_error_names(ctx, "no pose yet");
    assert_status(ctx, sf_path_wait(path, 0, 10), SF_ERR_TIMEOUT);
    assert_status(ctx, sf_path_open(ctx, name, &second_path), SF_ERR_IO); /* in use */

    test_log_clear();
    int one = connect_to(place);
    send_text(one, "10 0 0 0 0 0 0 1\n11 1 0 ");
    assert_int_equal(wait_for(path, 1).poses, 1);
    send_text(one, "0 0 0 0 1\nhello\n11 1 0 0 0 0 0 1\n10.5 3 0 0 0 0 0 1\n");
    sf_path_info info = wait_for(path, 5);
    assert_int_equal(info.poses, 2);
    assert_int_equal(info.malformed, 1);
    assert_int_equal(info.repeated, 1);
    assert_int_equal(info.late, 1);
    assert_true(info.live && info.first_ns == 15 * second && info.last_ns == 16 * second);
    test_assert_contains(test_log, "line 3: time: \"hello\" is not a number", __FILE__, __LINE__);
    assert_ok(ctx, sf_path_at(path, 31 * second / 2, R, t));
    assert_true(fabs(t[0] + 0.5) < 1e-12);

    memset(noise, '1', sizeof noise - 1);
    noise[sizeof noise - 1] = 0;
    test_log_clear();
    int two = connect_to(place);
    send_text(two, noise);
    send_text(two, "\n12 2 0 0 0 0 0 1");
    close(two); /* which ends its line */
    assert_ok(ctx, sf_path_wait(path, 17 * second, 5000));
    info = wait_for(path, 7);
    assert_int_equal(info.poses, 3);
    assert_int_equal(info.malformed, 2);
    assert_string_equal(test_log, ""); /* reported once */

    send_text(one, "3 7 0 0 0 0 0 1\n"); /* its clock began anew */
    info = wait_for(path, 8);
    assert_int_equal(info.restarted, 1);
    assert_true(info.first_ns == 8 * second && info.last_ns == 8 * second);
    sf_path_close(&path);
    close(one);
    assert_false(test_exists(place));
    sf_context_destroy(&ctx);
}

/* More poses than are kept: the newest stay. */
static void test_ring(void **state) {
    (void)state;
    enum { POSES = SF_PATH_KEPT + 1000 };
    sf_context *ctx = test_context();
    char name[512], place[256], line[64];
    snprintf(place, sizeof place, "%s", test_path("ring.sock"));
    snprintf(name, sizeof name, "unix:%s", place);
    sf_path *path = open_path(ctx, name);
    int fd = connect_to(place);
    for (int i = 0; i < POSES; i++) {
        snprintf(line, sizeof line, "%.2f %d 0 0 0 0 0 1\n", i * 0.01, i);
        send_text(fd, line);
    }
    sf_path_info info = wait_for(path, POSES);
    double R[9], t[3];
    assert_int_equal(info.poses, POSES);
    assert_true(info.first_ns == 1000 * second / 100);
    assert_ok(ctx, sf_path_at(path, info.first_ns + second / 200, R, t));
    assert_true(fabs(t[0] + 1000.5) < 1e-6);
    assert_status(ctx, sf_path_at(path, second, R, t), SF_ERR_EMPTY);
    close(fd);
    sf_path_close(&path);
    sf_context_destroy(&ctx);
}

static int send_to(const char *name, const char *text) {
    struct sockaddr_in to = {.sin_family = AF_INET};
    to.sin_port = htons((uint16_t)strtol(strrchr(name, ':') + 1, NULL, 10));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    ssize_t sent = sendto(fd, text, strlen(text), 0, (struct sockaddr *)&to, sizeof to);
    close(fd);
    return sent == (ssize_t)strlen(text);
}

/* Datagrams of one line and of several, on the clocks that there are. */
static void test_datagrams(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *clocks[3] = {"own", "unix", "arrival"};
    for (int i = 0; i < 3; i++) {
        char name[64], text[200];
        struct timespec now;
        sf_path_info info;
        double R[9], t[3];
        snprintf(name, sizeof name, "udp:127.0.0.1:0?gap=5&clock=%s", clocks[i]);
        sf_path *path = open_path(ctx, name);
        sf_path_describe(path, &info);
        test_assert_contains(info.name, "udp:127.0.0.1:", __FILE__, __LINE__);
        clock_gettime(CLOCK_REALTIME, &now);
        double time = i == 0 ? 50 : (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
        int64_t before = sf_clock_ns();
        snprintf(text, sizeof text, "%.6f 1 0 0 0 0 0 1\n%.6f 2 0 0 0 0 0 1", time, time + 0.001);
        assert_true(send_to(info.name, text));
        info = wait_for(path, 2);
        if (i == 0) assert_true(info.first_ns == 50 * second);
        if (i == 1) assert_true(llabs(info.first_ns - before) < second / 2);
        if (i == 2) assert_true(info.first_ns >= before && info.last_ns <= sf_clock_ns());
        if (i < 2) assert_ok(ctx, sf_path_at(path, info.first_ns + 500000, R, t));
        if (i < 2) assert_true(fabs(t[0] + 1.5) < 1e-2);
        sf_path_close(&path);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_between),   cmocka_unit_test(test_gaps_and_ends), cmocka_unit_test(test_rig),
        cmocka_unit_test(test_bad_files), cmocka_unit_test(test_bad_names),     cmocka_unit_test(test_stream),
        cmocka_unit_test(test_ring),      cmocka_unit_test(test_datagrams),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
