/* test_ply.c - Gaussians to .ply and back: what is written, and every kind of target. */
#include "ply_fixture.h"

#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void assert_same_model(const sf_model *a, const sf_model *b) {
    static values va, vb;
    size_t count = sf_model_count(a);
    assert_int_equal(sf_model_count(b), count);
    assert_int_equal(sf_model_sh_degree(b), sf_model_sh_degree(a));
    assert_int_equal(sf_model_antialiased(b), sf_model_antialiased(a));
    memset(&va, 0, sizeof va);
    memset(&vb, 0, sizeof vb);
    sf_gaussians ga = ply_arrays_of(&va), gb = ply_arrays_of(&vb);
    assert_int_equal(sf_model_get(a, 0, count, &ga), SF_OK);
    assert_int_equal(sf_model_get(b, 0, count, &gb), SF_OK);
    assert_memory_equal(&va, &vb, sizeof va);
}

static void assert_same_file(const char *a, const char *b) {
    size_t na, nb;
    uint8_t *da = test_read(a, &na), *db = test_read(b, &nb);
    assert_int_equal(na, nb);
    assert_memory_equal(da, db, na);
    free(da);
    free(db);
}

/* What is written. */

static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++) {
        sf_model *model = ply_make_model(ctx, MAX_COUNT - 1, degree), *again;
        sf_model_set_antialiased(model, degree % 2);
        const char *path = test_path("first.ply"), *second = test_path("second.ply");
        assert_ok(ctx, sf_model_save(model, path));
        assert_ok(ctx, sf_model_load(ctx, path, &again));
        assert_same_model(model, again);
        assert_ok(ctx, sf_model_save(again, second));
        assert_same_file(path, second);
        sf_model_destroy(&again);
        sf_model_destroy(&model);
    }
    sf_context_destroy(&ctx);
}

static void test_empty_model(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 0, 3), *again;
    const char *path = test_path("none.ply");
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_same_model(model, again);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* INRIA's layout byte by byte, at degree 1: coefficient k of colour c is 10 k + c. */
static void test_layout(void **state) {
    (void)state;
    static const char header[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property float nx\nproperty float ny\nproperty float nz\n"
        "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
        "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\nproperty float f_rest_3\n"
        "property float f_rest_4\nproperty float f_rest_5\nproperty float f_rest_6\nproperty float f_rest_7\n"
        "property float f_rest_8\nproperty float opacity\n"
        "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
        "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float "
        "rot_3\nend_header\n";
    static const float row[] = {1,  2,  3,  0,  0,  0,  0,  1,  2,    10, 20, 30, 11,
                                21, 31, 12, 22, 32, -4, -1, -2, -2.5, .1, .2, .3, .4};
    float means[] = {1, 2, 3}, quats[] = {.1f, .2f, .3f, .4f}, scales[] = {-1, -2, -2.5}, opacity[] = {-4};
    float sh[] = {0, 1, 2, 10, 11, 12, 20, 21, 22, 30, 31, 32};
    sf_gaussians g = {means, quats, scales, opacity, sh};
    sf_context *ctx = test_context();
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 1, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, 1, &g));
    file expected = {0};
    ply_put_text(&expected, header);
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) ply_put_f32(&expected, row[i]);
    const char *path = test_path("layout.ply");
    assert_ok(ctx, sf_model_save(model, path));
    size_t size;
    uint8_t *data = test_read(path, &size);
    assert_int_equal(size, expected.size);
    assert_memory_equal(data, expected.data, size);
    free(data);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_comment_only_where_antialiased(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 1, 0);
    for (int on = 0; on < 2; on++) {
        size_t size;
        const char *path = test_path("mip.ply");
        sf_model_set_antialiased(model, on);
        assert_ok(ctx, sf_model_save(model, path));
        char *text = (char *)test_read(path, &size);
        *strstr(text, "end_header") = 0;
        assert_int_equal(strstr(text, "\ncomment SplatRenderMode: mip\n") != NULL, on);
        assert_int_equal(strstr(text, "comment") != NULL, on);
        free(text);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Values that hurt other tools are refused by name; the file that stood there still stands. */
static void test_refuses_to_write(void **state) {
    (void)state;
    static values sound, broken;
    static const struct {
        float *at;
        float value;
        const char *part;
    } cases[] = {
        {&broken.means[3 * 7 + 1], NAN, "#7: y is nan"},
        {&broken.means[3 * 7 + 2], INFINITY, "#7: z is inf"},
        {&broken.log_scales[3 * 7 + 2], 20.001f, "#7: scale_2 is 20.001"},
        {&broken.log_scales[3 * 7], -40.001f, "#7: scale_0 is -40.001"},
        {&broken.logit_opacities[7], -INFINITY, "#7: opacity is -inf"},
        {&broken.sh[12 * 7 + 2], NAN, "#7: f_dc_2 is nan"},
        {&broken.sh[12 * 7 + 3 * 2 + 1], NAN, "#7: f_rest_4 is nan"},
        {&broken.quats[4 * 7 + 3], NAN, "#7: rot_3 is nan"},
        {NULL, 0, "#7: rot_0..3 are a zero quaternion"},
    };
    sf_context *ctx = test_context();
    const char *path = test_path("stands.ply");
    test_write(path, "old", 3);
    int entries = test_count_entries(test_folder());
    ply_make_values(&sound, 1);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        broken = sound;
        if (cases[i].at)
            *cases[i].at = cases[i].value;
        else
            for (int k = 0; k < 4; k++) broken.quats[4 * 7 + k] = 4e-13f;
        sf_model *model = ply_model_of(ctx, &broken, 9, 1);
        assert_status(ctx, sf_model_save(model, path), SF_ERR_ARGUMENT);
        assert_error_names(ctx, path);
        assert_error_names(ctx, cases[i].part);
        sf_model_destroy(&model);
        size_t size;
        uint8_t *data = test_read(path, &size);
        assert_int_equal(size, 3);
        assert_memory_equal(data, "old", 3);
        free(data);
        assert_int_equal(test_count_entries(test_folder()), entries);
    }
    sf_context_destroy(&ctx);
}

/* Where it is written. */

typedef struct pipe_reader {
    const char *path;
    uint8_t data[1 << 16];
    size_t size;
} pipe_reader;

static void *read_pipe(void *arg) {
    pipe_reader *r = arg;
    int fd = open(r->path, O_RDONLY);
    ssize_t got;
    while (fd >= 0 && (got = read(fd, r->data + r->size, sizeof r->data - r->size)) > 0)
        r->size += (size_t)got;
    if (fd >= 0) close(fd);
    return NULL;
}

static void assert_holds(const char *path, const uint8_t *data, size_t size) {
    size_t expected_size;
    uint8_t *expected = test_read(path, &expected_size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(data, expected, size);
    free(expected);
}

static void test_to_a_pipe(void **state) {
    (void)state;
    static pipe_reader reader;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 40, 3);
    const char *path = test_path("regular.ply");
    reader.path = test_path("fifo");
    assert_ok(ctx, sf_model_save(model, path));
    assert_int_equal(mkfifo(reader.path, 0600), 0);
    int entries = test_count_entries(test_folder());
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, read_pipe, &reader), 0);
    sf_status status = sf_model_save(model, reader.path);
    pthread_join(thread, NULL);
    assert_ok(ctx, status);
    assert_holds(path, reader.data, reader.size);
    struct stat st;
    assert_int_equal(lstat(reader.path, &st), 0);
    assert_true(S_ISFIFO(st.st_mode));
    assert_int_equal(test_count_entries(test_folder()), entries);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_to_devices(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 5, 0);
    struct stat st;
    assert_ok(ctx, sf_model_save(model, "/dev/null"));
    assert_int_equal(lstat("/dev/null", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
    if (test_exists("/dev/full")) {
        assert_status(ctx, sf_model_save(model, "/dev/full"), SF_ERR_IO);
        assert_error_names(ctx, "/dev/full");
        assert_int_equal(lstat("/dev/full", &st), 0);
        assert_true(S_ISCHR(st.st_mode));
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_to_standard_output(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 5, 0);
    const char *path = test_path("regular.ply"), *out = test_path("stdout.ply");
    assert_ok(ctx, sf_model_save(model, path));
    fflush(stdout);
    int kept = dup(STDOUT_FILENO), fd = open(out, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    assert_true(kept >= 0 && fd >= 0);
    dup2(fd, STDOUT_FILENO);
    sf_status status = sf_model_save(model, "-");
    int still_open = fcntl(STDOUT_FILENO, F_GETFD) >= 0;
    dup2(kept, STDOUT_FILENO);
    close(kept);
    close(fd);
    assert_ok(ctx, status);
    assert_true(still_open);
    assert_same_file(path, out);
    assert_false(test_exists("-"));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_through_a_link(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 5, 0);
    const char *target = test_path("linked.ply"), *path = test_path("link.ply"),
               *plain = test_path("regular.ply");
    test_write(target, "old", 3);
    assert_int_equal(symlink("linked.ply", path), 0);
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_save(model, plain));
    struct stat st;
    assert_int_equal(lstat(path, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    assert_same_file(target, plain);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_to_where_no_file_can_be(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 5, 0);
    test_write(test_path("a-file"), "old", 3);
    assert_int_equal(mkdir(test_path("a-folder"), 0700), 0);
    int entries = test_count_entries(test_folder());
    const char *paths[] = {test_path("a-file/model.ply"), test_path("a-folder"),
                           test_path("absent/model.ply"), ""};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        assert_status(ctx, sf_model_save(model, paths[i]), SF_ERR_IO);
        assert_error_names(ctx, paths[i]);
    }
    assert_int_equal(test_count_entries(test_folder()), entries);
    assert_int_equal(test_count_entries(test_path("a-folder")), 0);
    assert_holds(test_path("a-file"), (const uint8_t *)"old", 3);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_to_a_read_only_folder(void **state) {
    (void)state;
    if (geteuid() == 0) test_skip("root may write to a read-only folder");
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 5, 0);
    const char *folder = test_path("locked"), *path = test_path("locked/model.ply");
    assert_int_equal(mkdir(folder, 0700), 0);
    test_write(path, "old", 3);
    assert_int_equal(chmod(folder, 0500), 0);
    sf_status status = sf_model_save(model, path);
    chmod(folder, 0700);
    assert_status(ctx, status, SF_ERR_IO);
    assert_error_names(ctx, path);
    assert_holds(path, (const uint8_t *)"old", 3);
    assert_int_equal(test_count_entries(folder), 1);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_empty_model),
        cmocka_unit_test(test_layout),
        cmocka_unit_test(test_comment_only_where_antialiased),
        cmocka_unit_test(test_refuses_to_write),
        cmocka_unit_test(test_to_a_pipe),
        cmocka_unit_test(test_to_devices),
        cmocka_unit_test(test_to_standard_output),
        cmocka_unit_test(test_through_a_link),
        cmocka_unit_test(test_to_where_no_file_can_be),
        cmocka_unit_test(test_to_a_read_only_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
