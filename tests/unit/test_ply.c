/* test_ply.c - Gaussians to .ply and back, other tools' files, hostile files, and every kind of target. */
#include "testing.h"

#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/context.h"
#include "base/rng.h"
#include "io/ply.h"

/* Models. */

enum { MAX_COUNT = 64, MAX_K = 16 };

typedef struct values {
    float means[3 * MAX_COUNT], quats[4 * MAX_COUNT], log_scales[3 * MAX_COUNT], logit_opacities[MAX_COUNT];
    float sh[3 * MAX_K * MAX_COUNT];
} values;

static sf_gaussians arrays_of(values *v) {
    return (sf_gaussians){v->means, v->quats, v->log_scales, v->logit_opacities, v->sh};
}

static void fill(float *to, int count, double scale, sf_rng *rng) {
    for (int i = 0; i < count; i++) to[i] = (float)(scale * sf_rng_normal(rng));
}

static sf_model *model_of(sf_context *ctx, values *v, size_t count, int degree) {
    sf_model *model;
    sf_gaussians g = arrays_of(v);
    assert_ok(ctx, sf_model_create(ctx, count, degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, count, &g));
    return model;
}

/* Random values, and among them the ones that a careless conversion would lose. */
static void make_values(values *v, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    fill(v->means, 3 * MAX_COUNT, 10, &rng);
    fill(v->quats, 4 * MAX_COUNT, 1, &rng);
    fill(v->log_scales, 3 * MAX_COUNT, 2, &rng);
    fill(v->logit_opacities, MAX_COUNT, 4, &rng);
    fill(v->sh, 3 * MAX_K * MAX_COUNT, 0.3, &rng);
    v->means[0] = -0.0f;
    v->means[1] = 1e-42f;
    v->means[2] = 3.4028235e38f;
    v->log_scales[3] = 20;
    v->log_scales[4] = -20;
    v->sh[5] = -1e-45f;
}

static sf_model *make_model(sf_context *ctx, size_t count, int degree) {
    static values v;
    make_values(&v, (uint64_t)degree + 1);
    return model_of(ctx, &v, count, degree);
}

static void assert_same_model(const sf_model *a, const sf_model *b) {
    static values va, vb;
    size_t count = sf_model_count(a);
    assert_int_equal(sf_model_count(b), count);
    assert_int_equal(sf_model_sh_degree(b), sf_model_sh_degree(a));
    assert_int_equal(sf_model_antialiased(b), sf_model_antialiased(a));
    memset(&va, 0, sizeof va);
    memset(&vb, 0, sizeof vb);
    sf_gaussians ga = arrays_of(&va), gb = arrays_of(&vb);
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

/* Files made by hand, without the library. */

typedef struct file {
    size_t size;
    int big_endian;
    uint8_t data[1 << 15];
} file;

static void put(file *f, const void *data, size_t size) {
    assert_true(size <= sizeof f->data - f->size);
    memcpy(f->data + f->size, data, size);
    f->size += size;
}

static void put_text(file *f, const char *text) { put(f, text, strlen(text)); }

static void put_uint(file *f, uint64_t v, int size) {
    for (int i = 0; i < size; i++) {
        uint8_t byte = (uint8_t)(v >> (8 * (f->big_endian ? size - 1 - i : i)));
        put(f, &byte, 1);
    }
}

static void put_f32(file *f, float v) {
    uint32_t u;
    memcpy(&u, &v, sizeof u);
    put_uint(f, u, 4);
}

static void put_f64(file *f, double v) {
    uint64_t u;
    memcpy(&u, &v, sizeof u);
    put_uint(f, u, 8);
}

/* A new file each time: some file systems flush one that is overwritten, which takes long. */
static const char *write_bytes(const void *data, size_t size) {
    const char *path = test_path("made.ply");
    remove(path);
    test_write(path, data, size);
    return path;
}

static const char *write_file(const file *f) { return write_bytes(f->data, f->size); }

static const char *write_text(const char *text) { return write_bytes(text, strlen(text)); }

/* Degree 0 without normals. */
#define GAUSSIAN_PROPERTIES                                                                                  \
    "property float x\nproperty float y\nproperty float z\n"                                                 \
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"          \
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"                               \
    "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n"
enum { GAUSSIAN_VALUES = 14 };
static const float one_gaussian[GAUSSIAN_VALUES] = {1,  2,  3,  0.5f, 0.25f, 0.125f, -1,
                                                    -2, -3, -4, 1,    -7,    0.5f,   0};

static void assert_one_gaussian(const sf_model *model, size_t index) {
    float mean[3], quat[4], log_scale[3], opacity, sh[3];
    sf_gaussians g = {mean, quat, log_scale, &opacity, sh};
    assert_int_equal(sf_model_sh_degree(model), 0);
    assert_int_equal(sf_model_get(model, index, 1, &g), SF_OK);
    assert_memory_equal(mean, one_gaussian, sizeof mean);
    assert_memory_equal(sh, one_gaussian + 3, sizeof sh);
    assert_memory_equal(&opacity, one_gaussian + 6, sizeof opacity);
    assert_memory_equal(log_scale, one_gaussian + 7, sizeof log_scale);
    assert_memory_equal(quat, one_gaussian + 10, sizeof quat);
}

static void put_one_gaussian(file *f) {
    for (int i = 0; i < GAUSSIAN_VALUES; i++) put_f32(f, one_gaussian[i]);
}

/* Loads what must load, with one_gaussian at `index`. */
static void assert_loads(sf_context *ctx, const file *f, size_t count, size_t index) {
    sf_model *model;
    assert_ok(ctx, sf_model_load(ctx, write_file(f), &model));
    assert_int_equal(sf_model_count(model), count);
    assert_one_gaussian(model, index);
    sf_model_destroy(&model);
}

static void assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    sf_model *model = (sf_model *)ctx;
    assert_status(ctx, sf_model_load(ctx, path, &model), expected);
    assert_null(model);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

/* What is written. */

static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++) {
        sf_model *model = make_model(ctx, MAX_COUNT - 1, degree), *again;
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
    sf_model *model = make_model(ctx, 0, 3), *again;
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
    put_text(&expected, header);
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) put_f32(&expected, row[i]);
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
    sf_model *model = make_model(ctx, 1, 0);
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
        {&broken.log_scales[3 * 7], -20.001f, "#7: scale_0 is -20.001"},
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
    make_values(&sound, 1);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        broken = sound;
        if (cases[i].at)
            *cases[i].at = cases[i].value;
        else
            for (int k = 0; k < 4; k++) broken.quats[4 * 7 + k] = 4e-13f;
        sf_model *model = model_of(ctx, &broken, 9, 1);
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
    sf_model *model = make_model(ctx, 40, 3);
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
    sf_model *model = make_model(ctx, 5, 0);
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
    sf_model *model = make_model(ctx, 5, 0);
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
    sf_model *model = make_model(ctx, 5, 0);
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
    sf_model *model = make_model(ctx, 5, 0);
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
    sf_model *model = make_model(ctx, 5, 0);
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

/* What is read. */

/* Shuffled, of every type, with properties that nobody knows, CRLF lines, comments and other elements around.
 */
static void test_reads_any_order_and_type(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int big = 0; big < 2; big++) {
        file f = {.big_endian = big};
        put_text(&f, "ply\r\n");
        put_text(&f, big ? "format binary_big_endian 1.0\r\n" : "format binary_little_endian 1.0\r\n");
        put_text(&f, "comment Generated by a tool, with many words in it\r\nobj_info num_cols 1\r\n\r\n"
                     "element chunk 3\r\nproperty float min_x\r\nproperty ushort flags\r\n"
                     "element strip 2\r\nproperty list uchar int indices\r\nproperty char c\r\n"
                     "element nothing 2147483647\r\n"
                     "element vertex 2\r\ncomment SplatRenderMode: mip\r\n"
                     "property double rot_3\r\nproperty float64 rot_2\r\nproperty uchar label\r\n"
                     "property int8 rot_1\r\nproperty uint8 rot_0\r\nproperty short scale_2\r\n"
                     "property int16 scale_1\r\nproperty int scale_0\r\nproperty int32 opacity\r\n"
                     "property double confidence\r\nproperty float f_dc_2\r\nproperty float32 f_dc_1\r\n"
                     "property double f_dc_0\r\nproperty ushort z\r\nproperty uint16 y\r\nproperty uint x\r\n"
                     "element face 1\r\nproperty list uchar uint32 vertex_indices\r\nend_header\r\n");
        for (int i = 0; i < 3; i++) put_f32(&f, NAN), put_uint(&f, 7, 2);
        put_uint(&f, 0, 1), put_uint(&f, 1, 1);
        put_uint(&f, 2, 1), put_uint(&f, 5, 4), put_uint(&f, 6, 4), put_uint(&f, 1, 1);
        const float *g = one_gaussian;
        for (int i = 0; i < 2; i++) {
            put_f64(&f, g[13]), put_f64(&f, g[12]), put_uint(&f, 200, 1);
            put_uint(&f, (uint64_t)(int64_t)g[11], 1), put_uint(&f, (uint64_t)g[10], 1);
            put_uint(&f, (uint64_t)(int64_t)g[9], 2), put_uint(&f, (uint64_t)(int64_t)g[8], 2);
            put_uint(&f, (uint64_t)(int64_t)g[7], 4), put_uint(&f, (uint64_t)(int64_t)g[6], 4);
            put_f64(&f, NAN), put_f32(&f, g[5]), put_f32(&f, g[4]), put_f64(&f, g[3]);
            put_uint(&f, (uint64_t)g[2], 2), put_uint(&f, (uint64_t)g[1], 2), put_uint(&f, (uint64_t)g[0], 4);
        }
        put_uint(&f, 3, 1); /* a face that is cut off: not our concern */
        test_log_clear();
        assert_loads(ctx, &f, 2, 1);
        assert_string_equal(test_log, "");
        sf_model *model;
        assert_ok(ctx, sf_model_load(ctx, write_file(&f), &model));
        assert_true(sf_model_antialiased(model));
        sf_model_destroy(&model);
    }
    sf_context_destroy(&ctx);
}

static const char ascii_file[] = "ply\nformat ascii 1.0\nelement strip 2\nproperty list uchar int indices\n"
                                 "element nothing 2147483647\n"
                                 "element vertex 2\n" GAUSSIAN_PROPERTIES "end_header\n"
                                 "0\n2 7 8\n"
                                 "1e0 2 +3.0 .5 0.25 125e-3 -1 -2 -3 -4 1 -7 0.5 0\r\n"
                                 "\t 1 2 3 0.5 0.25 0.125 -1\n-2 -3 -4 1 -7 0.5 0";

static void test_reads_ascii(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, ascii_file);
    assert_loads(ctx, &f, 2, 0);
    assert_loads(ctx, &f, 2, 1);
    sf_context_destroy(&ctx);
}

static void test_ascii_in_a_locale_with_commas(void **state) {
    (void)state;
    static const char *const names[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "fr_FR", "ru_RU.UTF-8"};
    size_t i = 0;
    while (i < sizeof names / sizeof *names && !setlocale(LC_NUMERIC, names[i])) i++;
    if (i == sizeof names / sizeof *names) test_skip("no locale with a decimal comma is installed");
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, ascii_file);
    assert_loads(ctx, &f, 2, 0);
    assert_string_equal(localeconv()->decimal_point, ",");
    setlocale(LC_NUMERIC, "C");
    sf_context_destroy(&ctx);
}

static void test_skips_faulty_gaussians(void **state) {
    (void)state;
    static const struct {
        int at;
        float value;
    } faults[] = {{1, NAN}, {4, INFINITY}, {6, NAN}, {7, 20.5f}, {9, INFINITY}, {13, NAN}};
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f,
             "ply\nformat binary_little_endian 1.0\nelement vertex 12\n" GAUSSIAN_PROPERTIES "end_header\n");
    for (int i = 0; i < 5; i++) put_one_gaussian(&f);
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        for (int k = 0; k < GAUSSIAN_VALUES; k++)
            put_f32(&f, k == faults[i].at ? faults[i].value : one_gaussian[k]);
    for (int k = 0; k < GAUSSIAN_VALUES; k++) put_f32(&f, k >= 10 ? 0 : one_gaussian[k]);
    test_log_clear();
    assert_loads(ctx, &f, 5, 4);
    assert_non_null(strstr(test_log, "skipped 7 of 12 Gaussians"));
    assert_non_null(strstr(test_log, "first: #5, y is nan"));
    sf_context_destroy(&ctx);
}

/* A double beyond float's range is no number to us; the same in ascii. */
static void test_skips_what_a_float_cannot_hold(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, "ply\nformat ascii 1.0\nelement vertex 4\n" GAUSSIAN_PROPERTIES "end_header\n"
                 "1e39 2 3 0.5 0.25 0.125 -1 -2 -3 -4 1 -7 0.5 0\n"
                 "1 2 nan 0.5 0.25 0.125 -1 -2 -3 -4 1 -7 0.5 0\n"
                 "1 2 3 0.5 0.25 0.125 -1 -2 -3 -4 1 -7 0.5 0\n"
                 "1 2 3 0.5 0.25 0.125 -1 -2 -3 -4 1 -7 0.5 -inf\n");
    assert_loads(ctx, &f, 1, 0);
    sf_context_destroy(&ctx);
}

/* Opaque and invisible Gaussians have infinite logits, needles and points log-scales as low as can be. */
static void test_keeps_the_ends(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path =
        write_text("ply\nformat ascii 1.0\nelement vertex 3\n" GAUSSIAN_PROPERTIES "end_header\n"
                   "1 2 3 0.5 0.25 0.125 inf -2 -3 -4 1 -7 0.5 0\n"
                   "1 2 3 0.5 0.25 0.125 -inf -30 -inf -4 1 -7 0.5 0\n"
                   "1 2 3 0.5 0.25 0.125 1e300 -1e300 -20 20 1 -7 0.5 0\n");
    static const float logits[] = {20, -20, 20};
    static const float scales[] = {-2, -3, -4, -20, -20, -4, -20, -20, 20};
    float got_logits[3], got_scales[9];
    sf_gaussians got = {.logit_opacities = got_logits, .log_scales = got_scales};
    sf_model *model;
    test_log_clear();
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_int_equal(sf_model_count(model), 3);
    assert_ok(ctx, sf_model_get(model, 0, 3, &got));
    for (int i = 0; i < 3; i++) assert_true(got_logits[i] == logits[i]);
    for (int i = 0; i < 9; i++) assert_true(got_scales[i] == scales[i]);
    assert_null(strstr(test_log, "skipped"));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Colours of band 4 lie between those of the channels: the others keep their places. */
static void test_leaves_band_4_out(void **state) {
    (void)state;
    enum { REST = 72, HIGHER = 24, KEPT = 16 };
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES);
    for (int i = 0; i < REST; i++) {
        char line[40];
        snprintf(line, sizeof line, "property float f_rest_%d\n", i);
        put_text(&f, line);
    }
    put_text(&f, "end_header\n");
    put_one_gaussian(&f);
    for (int i = 0; i < REST; i++) put_f32(&f, (float)i);
    for (int degree = 3; degree >= 1; degree--) {
        const sf_model_file_options options = {.sh_degree = degree == 3 ? -1 : degree};
        float sh[3 * KEPT];
        sf_gaussians got = {.sh = sh};
        sf_model *model;
        test_log_clear();
        assert_ok(ctx, sf_model_load_as(ctx, write_file(&f), &options, &model));
        assert_int_equal(sf_model_sh_degree(model), degree);
        assert_ok(ctx, sf_model_get(model, 0, 1, &got));
        for (int k = 1; k < (degree + 1) * (degree + 1); k++)
            for (int c = 0; c < 3; c++) assert_true(sh[3 * k + c] == (float)(HIGHER * c + k - 1));
        assert_non_null(strstr(test_log, "band 4 of the SH is left out"));
        sf_model_destroy(&model);
    }
    sf_context_destroy(&ctx);
}

static void test_all_skipped_is_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f,
             "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES "end_header\n");
    for (int i = 0; i < GAUSSIAN_VALUES; i++) put_f32(&f, NAN);
    assert_refused(ctx, write_file(&f), SF_ERR_FORMAT, "none of its 1 Gaussians can be used");
    assert_error_names(ctx, "first: #0, x is nan");
    sf_context_destroy(&ctx);
}

static void test_bytes_after_the_end_are_reported(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f,
             "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES "end_header\n");
    put_one_gaussian(&f);
    put_text(&f, "xyz");
    test_log_clear();
    assert_loads(ctx, &f, 1, 0);
    assert_non_null(strstr(test_log, "3 bytes after the last vertex are ignored"));
    sf_context_destroy(&ctx);
}

/* What is refused. */

#define VERTEX(count) "ply\nformat binary_little_endian 1.0\nelement vertex " count "\n"
#define POINT         "property float x\nproperty float y\nproperty float z\n"
#define WITHOUT_Z     "property float x\nproperty float y\n"
#define END           "end_header\n"

static const struct {
    const char *text, *part;
    sf_status status;
} refused[] = {
    {"", "not a .ply file", SF_ERR_FORMAT},
    {"\n", "not a .ply file", SF_ERR_FORMAT},
    {"ply", "not a .ply file", SF_ERR_FORMAT},
    {"plyx\nformat ascii 1.0\n", "not a .ply file", SF_ERR_FORMAT},
    {"{\"a\": 1}\n", "not a .ply file", SF_ERR_FORMAT},
    {"ply\n", "end_header is missing", SF_ERR_FORMAT},
    {"ply\nelement vertex 0\n" GAUSSIAN_PROPERTIES END, "the format line is missing", SF_ERR_FORMAT},
    {"ply\nformat binary_middle_endian 1.0\n", "line 2: format 'binary_middle_endian' is unknown",
     SF_ERR_FORMAT},
    {"ply\nformat ascii 2.0\n", "line 2: format is not of version 1.0", SF_ERR_FORMAT},
    {"ply\nformat ascii\n", "line 2: format is not of version 1.0", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelephant vertex 1\n", "line 3: 'elephant'", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nproperty float x\n", "line 3: property without an element", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex\n", "line 3: element without", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1 2\n", "line 3: element without", SF_ERR_FORMAT},
    {VERTEX("1") "property float\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property float x y\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property list uchar x\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property float128 x\n", "line 4: type 'float128'", SF_ERR_FORMAT},
    {VERTEX("1") "property list float int x\n", "property x: its length is of type float", SF_ERR_FORMAT},
    {VERTEX("1") POINT "property float x\n", "property x: given twice", SF_ERR_FORMAT},
    {VERTEX("1") POINT "element vertex 2\n", "element vertex: given twice", SF_ERR_FORMAT},
    {VERTEX("1") POINT "property list uchar int tags\n" END, "property tags is a list", SF_ERR_UNSUPPORTED},
    {"ply\nformat ascii 1.0\nelement face 0\n" END, "element vertex is missing", SF_ERR_FORMAT},
    {VERTEX("-1"), "element vertex: count '-1'", SF_ERR_FORMAT},
    {VERTEX("1.5"), "element vertex: count '1.5'", SF_ERR_FORMAT},
    {VERTEX("0x10"), "element vertex: count '0x10'", SF_ERR_FORMAT},
    {VERTEX("2147483648"), "element vertex: count '2147483648'", SF_ERR_FORMAT},
    {VERTEX("4294967296"), "element vertex: count '4294967296'", SF_ERR_FORMAT},
    {VERTEX("9223372036854775808"), "element vertex: count '9223372036854775808'", SF_ERR_FORMAT},
    {VERTEX("18446744073709551617"), "element vertex: count '18446744073709551617'", SF_ERR_FORMAT},
    {VERTEX("2147483647") GAUSSIAN_PROPERTIES END, "truncated: 120259084232 bytes are missing",
     SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 2147483647\n" GAUSSIAN_PROPERTIES END "1 2 3",
     "truncated: at least 60129542110 bytes are missing", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 3 4 5 6 7 8 9.000000000000000 10\n",
     "truncated: ends before property rot_0 of vertex 0 of 1", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 red 4 5 6 7 8 9 10 11 12 13 14\n",
     "vertex 0: property z: 'red' is not a number", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 3,4 5 6 7 8 9 10 11 12 13 14 15\n",
     "vertex 0: property z: '3,4' is not a number", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement strip 1\nproperty list uchar int tags\nelement vertex 0\n" END "-3\n",
     "strip 0: property tags: length -3", SF_ERR_FORMAT},
    {"ply\nformat binary_little_endian 1.0\nelement strip 2147483647\nproperty list uchar int tags\n"
     "element vertex 0\n" END "\x01"
     "abcd",
     "truncated: ends before property tags of strip 1", SF_ERR_FORMAT},
    {"ply\nformat binary_little_endian 1.0\nelement chunk 2147483647\nproperty double a\nelement vertex "
     "0\n" END,
     "truncated: 17179869176 bytes are missing for element chunk", SF_ERR_FORMAT},
    {VERTEX("0") GAUSSIAN_PROPERTIES "property float f_rest_0\n" END, "1 properties f_rest, not",
     SF_ERR_FORMAT},
    {VERTEX("0") GAUSSIAN_PROPERTIES
     "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\nproperty float f_rest_3\n"
     "property float f_rest_4\nproperty float f_rest_6\nproperty float f_rest_7\nproperty float f_rest_8\n"
     "property float f_rest_9\n" END,
     "property f_rest_5 is missing", SF_ERR_FORMAT},
};

static void test_refuses_to_read(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_refused(ctx, write_text(refused[i].text), refused[i].status, refused[i].part);
    sf_context_destroy(&ctx);
}

/* What tools call a model too is named, with what to do next. */
static void test_names_other_kinds(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *ksplat = test_path("model.ksplat");
    test_write(ksplat, "\0\1", 2);
    assert_refused(ctx, ksplat, SF_ERR_UNSUPPORTED, "GaussianSplats3D");
    assert_error_names(ctx, "@playcanvas/splat-transform");
    assert_refused(ctx, write_text(VERTEX("0") POINT "property float scale_0\nproperty float scale_1\n" END),
                   SF_ERR_UNSUPPORTED, "2DGS");
    sf_context_destroy(&ctx);
}

/* Each property in turn gets another name. */
static void test_names_the_missing_property(void **state) {
    (void)state;
    static const char *const names[GAUSSIAN_VALUES] = {"x",      "y",       "z",       "f_dc_0",  "f_dc_1",
                                                       "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
                                                       "rot_0",  "rot_1",   "rot_2",   "rot_3"};
    sf_context *ctx = test_context();
    for (int missing = 0; missing < GAUSSIAN_VALUES; missing++) {
        file f = {0};
        char line[64];
        put_text(&f, VERTEX("0"));
        for (int i = 0; i < GAUSSIAN_VALUES; i++) {
            snprintf(line, sizeof line, "property float %s%s\n", i == missing ? "no_" : "", names[i]);
            put_text(&f, line);
        }
        put_text(&f, END);
        snprintf(line, sizeof line, "property %s is missing", names[missing]);
        assert_refused(ctx, write_file(&f), missing == 9 ? SF_ERR_UNSUPPORTED : SF_ERR_FORMAT, line);
    }
    sf_context_destroy(&ctx);
}

static void test_refuses_endless_headers(void **state) {
    (void)state;
    static file f;
    char line[32];
    sf_context *ctx = test_context();
    put_text(&f, VERTEX("0"));
    for (int i = 0; i < 1000; i++) {
        snprintf(line, sizeof line, "property float p%d\n", i);
        put_text(&f, line);
    }
    put_text(&f, END);
    assert_refused(ctx, write_file(&f), SF_ERR_UNSUPPORTED, "property p512: more than 512 properties");
    f.size = 0;
    put_text(&f, "ply\nformat ascii 1.0\n");
    for (int i = 0; i < 100; i++) {
        snprintf(line, sizeof line, "element e%d 0\n", i);
        put_text(&f, line);
    }
    put_text(&f, END);
    assert_refused(ctx, write_file(&f), SF_ERR_UNSUPPORTED, "element e16: more than 16 elements");
    sf_context_destroy(&ctx);
}

static void test_refuses_what_is_no_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_refused(ctx, test_path("absent.ply"), SF_ERR_IO, "absent.ply");
    assert_refused(ctx, test_folder(), SF_ERR_IO, "");
    assert_refused(ctx, "/dev/null", SF_ERR_IO, "");
    sf_context_destroy(&ctx);
}

static void test_refuses_garbage(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    while (f.size < 4096) put_uint(&f, sf_rng_next(&rng), 8);
    assert_refused(ctx, write_file(&f), SF_ERR_FORMAT, "not a .ply file");
    memcpy(f.data, "ply\n", 4);
    assert_refused(ctx, write_file(&f), SF_ERR_FORMAT, "line 2");
    sf_context_destroy(&ctx);
}

/* Every proper beginning of a file is an error. */
static void test_truncation_at_every_byte(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = make_model(ctx, 2, 0);
    const char *path = test_path("whole.ply");
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    size_t size;
    uint8_t *data = test_read(path, &size);
    size_t header = size - 2 * 17 * sizeof(float);
    for (size_t cut = 0; cut < size; cut++) {
        char missing[64] = "";
        if (cut >= header) snprintf(missing, sizeof missing, "truncated: %zu bytes are missing", size - cut);
        assert_refused(ctx, write_bytes(data, cut), SF_ERR_FORMAT, missing);
    }
    free(data);
    sf_context_destroy(&ctx);
}

/* In text the last number may lose its end unseen; all that is lost with its blank before is missed. */
static void test_truncation_of_text(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    size_t end = strlen(ascii_file) - strlen(" 0");
    for (size_t cut = 0; cut <= end; cut++)
        assert_refused(ctx, write_bytes(ascii_file, cut), SF_ERR_FORMAT, "");
    sf_context_destroy(&ctx);
}

static void assert_whole_or_refused(sf_context *ctx, const char *path) {
    sf_model *model = (sf_model *)ctx;
    float *xyz;
    uint8_t *rgb;
    size_t count;
    sf_status status = sf_model_load(ctx, path, &model);
    assert_int_equal(status == SF_OK, model != NULL);
    sf_model_destroy(&model);
    status = sf_ply_read_points(ctx, path, &xyz, &rgb, &count);
    assert_int_equal(status == SF_OK, xyz != NULL);
    assert_int_equal(status == SF_OK, rgb != NULL);
    sf_free(ctx, xyz);
    sf_free(ctx, rgb);
}

/* Each byte in turn becomes another: a model or an error, never a crash. */
static void change_every_byte(sf_context *ctx, const file *whole) {
    static const uint8_t others[] = {0, '\n', ' ', '9', 0xff};
    for (size_t at = 0; at < whole->size; at++)
        for (size_t i = 0; i < sizeof others; i++) {
            file f = *whole;
            f.data[at] = others[i];
            assert_whole_or_refused(ctx, write_file(&f));
        }
}

static void test_survives_changed_bytes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, "ply\nformat binary_little_endian 1.0\nelement strip 2\nproperty list uchar int indices\n"
                 "element vertex 1\n" GAUSSIAN_PROPERTIES "property uchar red\n" END);
    put_uint(&f, 1, 1), put_uint(&f, 5, 4), put_uint(&f, 0, 1);
    put_one_gaussian(&f);
    put_uint(&f, 9, 1);
    change_every_byte(ctx, &f);
    f.size = 0;
    put_text(&f, ascii_file);
    change_every_byte(ctx, &f);
    sf_context_destroy(&ctx);
}

/* An allocator that gives out a number of blocks and then none. */
typedef struct short_memory {
    long left, out;
} short_memory;

static void *short_alloc(void *user, size_t size) {
    short_memory *m = user;
    if (m->left-- <= 0) return NULL;
    m->out++;
    return malloc(size);
}

static void short_free(void *user, void *block) {
    ((short_memory *)user)->out -= block != NULL;
    free(block);
}

static void test_no_memory(void **state) {
    (void)state;
    short_memory memory = {.left = 1000};
    sf_allocator allocator = {short_alloc, short_free, &memory};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    file f = {0};
    put_text(&f, VERTEX("1") GAUSSIAN_PROPERTIES END);
    put_one_gaussian(&f);
    const char *path = write_file(&f);
    long before = memory.out;
    sf_status status = SF_ERR_MEMORY;
    for (long blocks = 0; status; blocks++) {
        sf_model *model = (sf_model *)ctx;
        memory.left = blocks;
        status = sf_model_load(ctx, path, &model);
        assert_true(status == SF_OK || status == SF_ERR_MEMORY);
        assert_int_equal(status == SF_OK, model != NULL);
        sf_model_destroy(&model);
        assert_int_equal(memory.out, before);
        assert_true(blocks < 100);
    }
    memory.left = 1000;
    sf_context_destroy(&ctx);
    assert_int_equal(memory.out, 0);
}

/* Points. */

typedef struct points {
    float *xyz;
    uint8_t *rgb;
    size_t count;
} points;

static points read_points(sf_context *ctx, const file *f) {
    points p;
    assert_ok(ctx, sf_ply_read_points(ctx, write_file(f), &p.xyz, &p.rgb, &p.count));
    return p;
}

static void free_points(sf_context *ctx, points *p) {
    sf_free(ctx, p->xyz);
    sf_free(ctx, p->rgb);
}

static void test_points_binary(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, VERTEX("3") "property double x\nproperty double y\nproperty double z\nproperty float nx\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\n" END);
    for (int i = 0; i < 3; i++) {
        put_f64(&f, i + 0.5), put_f64(&f, i == 1 ? NAN : -i), put_f64(&f, i == 2 ? 1e300 : 7), put_f32(&f, 1);
        for (int c = 0; c < 3; c++) put_uint(&f, (uint64_t)(100 * i + c), 1);
    }
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 3);
    for (int i = 0; i < 3; i++) {
        assert_true(p.xyz[3 * i] == i + 0.5);
        for (int c = 0; c < 3; c++) assert_int_equal(p.rgb[3 * i + c], 100 * i + c);
    }
    assert_true(isnan(p.xyz[4]));
    assert_false(isfinite(p.xyz[8]));
    assert_true(p.xyz[5] == 7);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

#define ASCII_POINTS                                                                                         \
    "ply\nformat ascii 1.0\nelement vertex 2\n" POINT                                                        \
    "property uchar red\nproperty uchar green\nproperty uchar blue\n" END

static void test_points_ascii(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, ASCII_POINTS "1 2 3 255 0 1\n4 5 6 7 8 9\n");
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 2);
    assert_memory_equal(p.xyz, ((float[]){1, 2, 3, 4, 5, 6}), 6 * sizeof(float));
    assert_memory_equal(p.rgb, ((uint8_t[]){255, 0, 1, 7, 8, 9}), 6);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

static void assert_grey(sf_context *ctx, const char *color_properties, int color_bytes) {
    file f = {0};
    put_text(&f, VERTEX("2") POINT);
    put_text(&f, color_properties);
    put_text(&f, END);
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 3; k++) put_f32(&f, (float)(3 * i + k));
        put_uint(&f, 0, color_bytes);
    }
    test_log_clear();
    points p = read_points(ctx, &f);
    assert_memory_equal(p.xyz, ((float[]){0, 1, 2, 3, 4, 5}), 6 * sizeof(float));
    assert_memory_equal(p.rgb, ((uint8_t[]){128, 128, 128, 128, 128, 128}), 6);
    assert_non_null(strstr(test_log, "grey"));
    free_points(ctx, &p);
}

static void test_points_without_colors_are_grey(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_grey(ctx, "", 0);
    assert_grey(ctx, "property ushort red\nproperty ushort green\nproperty ushort blue\n", 6);
    assert_grey(ctx, "property uchar red\nproperty uchar green\n", 2);
    sf_context_destroy(&ctx);
}

static void test_points_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    put_text(&f, VERTEX("0") POINT END);
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 0);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_points_refused(void **state) {
    (void)state;
    static const struct {
        const char *text, *part;
    } cases[] = {
        {VERTEX("0") WITHOUT_Z END, "property z is missing"},
        {VERTEX("1") POINT END "12345678901", "truncated: 1 bytes are missing"},
        {VERTEX("2147483647") POINT END, "bytes are missing"},
        {VERTEX("9223372036854775808") POINT END, "count '9223372036854775808'"},
        {"ply\nformat ascii 1.0\nelement vertex 2\n" POINT END "1.0 2.0 3.0 4.0 5.0\n",
         "ends before property z of vertex 1"},
        {ASCII_POINTS "1 2 3 255 0 1\n1 2 3 0 -1 0\n", "vertex 1: property green: -1 is not in 0..255"},
        {ASCII_POINTS "1 2 3 255 0 256\n1 2 3 0 1 0\n", "vertex 0: property blue: 256 is not in 0..255"},
        {ASCII_POINTS "1 2 3 1e99 0 1\n1 2 3 0 1 0\n", "vertex 0: property red: inf is not in 0..255"},
        {"", "not a .ply file"},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        points p = {(float *)ctx, (uint8_t *)ctx, 1};
        const char *path = write_text(cases[i].text);
        assert_status(ctx, sf_ply_read_points(ctx, path, &p.xyz, &p.rgb, &p.count), SF_ERR_FORMAT);
        assert_null(p.xyz);
        assert_null(p.rgb);
        assert_int_equal(p.count, 0);
        assert_error_names(ctx, path);
        assert_error_names(ctx, cases[i].part);
    }
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
        cmocka_unit_test(test_reads_any_order_and_type),
        cmocka_unit_test(test_reads_ascii),
        cmocka_unit_test(test_ascii_in_a_locale_with_commas),
        cmocka_unit_test(test_skips_faulty_gaussians),
        cmocka_unit_test(test_skips_what_a_float_cannot_hold),
        cmocka_unit_test(test_keeps_the_ends),
        cmocka_unit_test(test_leaves_band_4_out),
        cmocka_unit_test(test_all_skipped_is_refused),
        cmocka_unit_test(test_bytes_after_the_end_are_reported),
        cmocka_unit_test(test_refuses_to_read),
        cmocka_unit_test(test_names_other_kinds),
        cmocka_unit_test(test_names_the_missing_property),
        cmocka_unit_test(test_refuses_endless_headers),
        cmocka_unit_test(test_refuses_what_is_no_file),
        cmocka_unit_test(test_refuses_garbage),
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_truncation_of_text),
        cmocka_unit_test(test_survives_changed_bytes),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_points_binary),
        cmocka_unit_test(test_points_ascii),
        cmocka_unit_test(test_points_without_colors_are_grey),
        cmocka_unit_test(test_points_none),
        cmocka_unit_test(test_points_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
