/* test_calibrate_pictures.c - calibration from rendered pictures and photographs, its commands, and memory.
 */
#include "calibrate_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "base/rng.h"
#include "io/picture.h"
#include "base/linear.h"
#include "pose/edge_bias.h"
#include "pose/tags.h"
#include "pose/view.h"

/* The bar: focal length within 0.3 %, principal point within 1 px, k1 within 0.01. */
static void assert_within_bar(const sf_calibration *c) {
    assert_true(fabs(c->lens.fx / calibrate_truth.fx - 1) < 0.003);
    assert_true(fabs(c->lens.fy / calibrate_truth.fy - 1) < 0.003);
    assert_true(fabs(c->lens.cx - calibrate_truth.cx) < 1);
    assert_true(fabs(c->lens.cy - calibrate_truth.cy) < 1);
    assert_true(fabs(c->lens.k1 - calibrate_truth.k1) < 0.01);
}

/* Rendered pictures: the board's cells looked up through the lens, sensor noise and blur. */

enum { SAMPLES = 2, CELL_COLUMNS = 4 * 10 - 2, CELL_ROWS = 5 * 10 - 2, QUIET = 4 };

typedef struct studio {
    float *rays; /* [HEIGHT * SAMPLES][WIDTH * SAMPLES][2] */
    uint8_t cells[CELL_ROWS][CELL_COLUMNS];
    double cell; /* m */
    uint8_t grey[HEIGHT][WIDTH];
} studio;

static studio *make_studio(const fixture *f) {
    studio *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->rays = malloc(sizeof *s->rays * 2 * WIDTH * HEIGHT * SAMPLES * SAMPLES);
    assert_non_null(s->rays);
    s->cell = f->board->tag_size / 8;
    for (size_t t = 0; t < f->board->count; t++) {
        uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
        int side;
        assert_ok(f->ctx, sf_tags_cells(f->ctx, "tag36h11", (int)t, &side, cells));
        assert_int_equal(side, 8);
        for (int i = 0; i < 64; i++)
            s->cells[t / 4 * 10 + (size_t)i / 8][t % 4 * 10 + (size_t)i % 8] = cells[i];
    }
    for (int y = 0; y < HEIGHT * SAMPLES; y++)
        for (int x = 0; x < WIDTH * SAMPLES; x++) {
            double ray[2], pixel[2] = {(x + 0.5) / SAMPLES, (y + 0.5) / SAMPLES};
            assert_true(sf_lens_ray(&calibrate_truth, pixel, ray));
            float *at = s->rays + 2 * ((size_t)y * WIDTH * SAMPLES + (size_t)x);
            at[0] = (float)ray[0];
            at[1] = (float)ray[1];
        }
    return s;
}

static void free_studio(studio *s) {
    free(s->rays);
    free(s);
}

/* Cameras blur light, and encode it after that. */
#define GAMMA 2.2

/* Bytes of the background, of white and of black. */
enum { AROUND, WHITE, BLACK };
static const double bytes[] = {105, 215, 30};

/* Which is at a point of the board's plane, in cells from its upper left. */
static int shade(const studio *s, double x, double y) {
    if (x < -QUIET || y < -QUIET || x >= CELL_COLUMNS + QUIET || y >= CELL_ROWS + QUIET) return AROUND;
    if (x < 0 || y < 0 || x >= CELL_COLUMNS || y >= CELL_ROWS) return WHITE;
    return s->cells[(int)y][(int)x] ? BLACK : WHITE;
}

/* Gauss' blur along one axis, for a standard deviation of `sigma` px. */
static void blur_along(float *picture, size_t count, size_t length, size_t step, size_t line_step,
                       double sigma) {
    enum { REACH = 3 };
    float weights[REACH + 1], sum = 0, line[WIDTH + 2 * REACH];
    for (int i = 0; i <= REACH; i++) {
        weights[i] = (float)exp(-i * i / (2 * sigma * sigma));
        sum += (i ? 2 : 1) * weights[i];
    }
    for (size_t l = 0; l < count; l++) {
        float *at = picture + l * line_step;
        for (size_t i = 0; i < length + 2 * REACH; i++) {
            size_t from = i < REACH ? 0 : i - REACH;
            line[i] = at[(from < length ? from : length - 1) * step];
        }
        for (size_t i = 0; i < length; i++) {
            const float *m = line + i + REACH;
            float mean = weights[0] * m[0];
            for (int k = 1; k <= REACH; k++) mean += weights[k] * (m[k] + m[-k]);
            at[i * step] = mean / sum;
        }
    }
}

/* A table of the sensor's noise, read from another place in each row: normal numbers are slow. */
enum { NOISE = 1 << 14 };

static void make_noise(float table[NOISE], double sigma, sf_rng *rng) {
    for (int i = 0; i < NOISE; i++) table[i] = (float)(sigma * sf_rng_normal(rng));
}

static void render(studio *s, const sf_rigid *T, double blur, double noise, sf_rng *rng) {
    static float picture[HEIGHT * WIDTH], table[NOISE];
    /* A ray d meets the plane where n . (l d - t) = 0; its place is x . (l d - t), y . (l d - t). */
    double n[3], a[3], b[3];
    for (int i = 0; i < 3; i++) {
        a[i] = T->R[3 * i];
        b[i] = T->R[3 * i + 1];
        n[i] = T->R[3 * i + 2];
    }
    double nt = sf_dot3(n, T->t), at = sf_dot3(a, T->t), bt = sf_dot3(b, T->t), light[3];
    for (int i = 0; i < 3; i++) light[i] = pow(bytes[i] / 255, GAMMA) / (SAMPLES * SAMPLES);
    memset(picture, 0, sizeof picture);
    for (size_t y = 0; y < HEIGHT * SAMPLES; y++)
        for (size_t x = 0; x < WIDTH * SAMPLES; x++) {
            const float *ray = s->rays + 2 * (y * WIDTH * SAMPLES + x);
            double d[3] = {(double)ray[0], (double)ray[1], 1}, l = nt / sf_dot3(n, d);
            double u = (l * sf_dot3(a, d) - at) / s->cell + CELL_COLUMNS / 2.0;
            double v = (l * sf_dot3(b, d) - bt) / s->cell + CELL_ROWS / 2.0;
            picture[y / SAMPLES * WIDTH + x / SAMPLES] += (float)light[shade(s, u, v)];
        }
    if (blur > 0) {
        blur_along(picture, HEIGHT, WIDTH, 1, WIDTH, blur);
        blur_along(picture, WIDTH, HEIGHT, WIDTH, 1, blur);
    }
    make_noise(table, noise, rng);
    for (size_t y = 0; y < HEIGHT; y++) {
        size_t from = sf_rng_below(rng, NOISE - WIDTH);
        for (size_t x = 0; x < WIDTH; x++) {
            float value = 255 * powf(picture[y * WIDTH + x], (float)(1 / GAMMA)) + table[from + x] + 0.5f;
            s->grey[y][x] = value > 0 ? value < 255 ? (uint8_t)value : 255 : 0;
        }
    }
}

/* How far the detector's corners are from where the lens puts them. */
typedef struct offsets {
    double mean[2], squares, along; /* `along`: away from the tag's middle */
    size_t count;
} offsets;

static void measure_offsets(const sf_rigid *T, const sf_board_corner *corners, size_t count, offsets *o) {
    for (size_t i = 0; i < count; i++) {
        const double *b = corners[i].board;
        double p[3], pixel[2], d[2], out[2] = {0}, length;
        for (int k = 0; k < 3; k++) p[k] = T->R[3 * k] * b[0] + T->R[3 * k + 1] * b[1] + T->t[k];
        assert_true(sf_lens_project(&calibrate_truth, p, pixel, NULL, NULL));
        for (int k = 0; k < 2; k++) {
            d[k] = corners[i].pixel[k] - pixel[k];
            o->mean[k] += d[k];
            o->squares += d[k] * d[k];
            out[k] =
                corners[i].pixel[k] - (corners[i - i % 4].pixel[k] + corners[i - i % 4 + 2].pixel[k]) / 2;
        }
        length = hypot(out[0], out[1]);
        o->along += (d[0] * out[0] + d[1] * out[1]) / length;
        o->count++;
    }
}

/* Edges that are seen outwards of where they are, or inwards, make nothing of the pose, nor of the lens:
 * boards of six tags and more, which stand apart. A tag alone does not tell it from its distance. */
static void test_swollen_edges(void **state) {
    (void)state;
    static const double biases[] = {-0.4, -0.1, 0.2, 0.5};
    fixture f;
    sf_calibration c;
    calibrate_begin(&f, 5);
    for (size_t k = 0; k < sizeof biases / sizeof *biases; k++) {
        double worst = 0, without = 0;
        sf_observations_destroy(&f.observations);
        assert_ok(f.ctx, sf_observations_create(f.ctx, WIDTH, HEIGHT, &f.observations));
        for (size_t i = 0; i < STANDS; i++) {
            sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[i]);
            sf_pose pose;
            size_t n = calibrate_project_board(f.board, &calibrate_truth, &T, 0.05, &f.rng, f.corners);
            if (n < 24) continue;
            sf_shift_edges(f.corners, n, biases[k]);
            assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
            assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, n, &pose));
            double off[3];
            for (int d = 0; d < 3; d++) off[d] = pose.t_cb[d] - T.t[d];
            worst = fmax(worst, sqrt(sf_dot3(off, off) / sf_dot3(T.t, T.t)));
            assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, 4, &pose)); /* a tag alone */
            for (int d = 0; d < 3; d++) off[d] = pose.t_cb[d] - T.t[d];
            without = fmax(without, sqrt(sf_dot3(off, off) / sf_dot3(T.t, T.t)));
        }
        assert_ok(f.ctx, sf_calibrate(f.observations, NULL, &c));
        print_message(
            "edges %+.1f px outwards: poses off by %.4f of the distance at most, %.4f by a tag alone; fx "
            "by %+.3f %%, rms %.3f px\n",
            biases[k], worst, without, 100 * (c.lens.fx / calibrate_truth.fx - 1), c.rms);
        assert_true(worst < 0.002);
        assert_true(without > fabs(biases[k]) / 100);
        assert_true(fabs(c.lens.fx / calibrate_truth.fx - 1) < 0.002);
        assert_true(c.rms < 0.1);
    }
    calibrate_end(&f);
}

static int have_tags(sf_context *ctx) {
    int side;
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    return sf_tags_cells(ctx, "tag36h11", 0, &side, cells) != SF_ERR_UNSUPPORTED;
}

static void need_tags(fixture *f) {
    if (have_tags(f->ctx)) return;
    calibrate_end(f);
    test_skip("not built with libapriltag");
}

/* Runs the program; returns its exit code. What it said is in *said, free()d by the caller. */
static int run_program(const char *arguments, char **said) {
    char command[4096];
    const char *program = getenv("SPLATFIT_PROGRAM"), *run = getenv("RUN");
    size_t size;
    snprintf(command, sizeof command, "%s %s %s >%s 2>&1", run ? run : "",
             program ? program : "build/splatfit", arguments, test_path("said.txt"));
    int status = system(command);
    *said = (char *)test_read(test_path("said.txt"), &size);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

/* The program on the same frames, as a pipe gives them. */
static void run_command(sf_context *ctx) {
    char arguments[2048], *said;
    sf_calibration c;
    snprintf(arguments, sizeof arguments, "calibrate 'pipe:%s?size=640x480&format=GREY' --decimate 2 -o %s",
             test_path("frames.grey"), test_path("camera.json"));
    int code = run_program(arguments, &said);
    if (code) print_error("%s: %s\n", arguments, said);
    assert_int_equal(code, 0);
    test_assert_contains(said, "reprojection error 0.", __FILE__, __LINE__);
    test_assert_contains(said, " % of 8 x 6 cells", __FILE__, __LINE__);
    free(said);
    assert_ok(ctx, sf_calibration_load(ctx, test_path("camera.json"), &c));
    calibrate_print_lens("splatfit calibrate", &c);
    assert_within_bar(&c);
    assert_true(c.width == WIDTH && c.height == HEIGHT && c.views >= 12);
}

static void test_rendered_boards(void **state) {
    (void)state;
    fixture f;
    sf_detector *detector;
    sf_calibration c;
    offsets o = {0};
    calibrate_begin(&f, 30);
    need_tags(&f);
    studio *s = make_studio(&f);
    FILE *frames = fopen(test_path("frames.grey"), "wb");
    assert_non_null(frames);
    assert_ok(f.ctx, sf_detector_create(f.ctx, f.board, 1, &detector));
    for (size_t i = 0; i < (test_is_quick() ? 4 : STANDS); i++) {
        const sf_board_corner *corners;
        size_t count;
        sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[i]);
        render(s, &T, 0.5 + 0.1 * (double)(i % 6), 4, &f.rng);
        assert_ok(f.ctx, sf_detector_find(detector, s->grey[0], WIDTH, WIDTH, HEIGHT, &corners, &count));
        assert_true(count >= 40);
        assert_int_equal(fwrite(s->grey, sizeof s->grey, 1, frames), 1);
        measure_offsets(&T, corners, count, &o);
        assert_ok(f.ctx, sf_observations_add(f.observations, corners, count));
    }
    assert_int_equal(fclose(frames), 0);
    double n = (double)o.count;
    print_message("corners found: off by %+.3f, %+.3f px in the mean, %+.3f px outwards, %.3f px rms\n",
                  o.mean[0] / n, o.mean[1] / n, o.along / n, sqrt(o.squares / n));
    assert_true(fabs(o.mean[0] / n) < 0.05 && fabs(o.mean[1] / n) < 0.05);
    assert_true(sqrt(o.squares / n) < 0.3);
    assert_ok(f.ctx, sf_calibrate(f.observations, NULL, &c));
    calibrate_print_lens("rendered boards", &c);
    assert_true(c.rms < 0.3);
    if (test_is_quick())
        calibrate_assert_as_told(&c);
    else {
        assert_within_bar(&c);
        run_command(f.ctx);
    }
    sf_detector_destroy(&detector);
    free_studio(s);
    calibrate_end(&f);
}

static void test_commands(void **state) {
    (void)state;
    static const struct {
        int code, needs_tags;
        const char *arguments, *says;
    } cases[] = {
        {2, 0, "board", "--output FILE: is needed"},
        {2, 0, "board -o x.bmp", "x.bmp: ending"},
        {2, 0, "board -o x.pdf --board a5", "\"a5\" is none of"},
        {2, 0, "calibrate", "one of the two is needed"},
        {2, 0, "calibrate sim:studio --convert x.yaml", "one of the two is needed"},
        {2, 0, "calibrate sim:studio --tag-size 0", "--tag-size: \"0\" is not a number"},
        {2, 0, "calibrate sim:studio --radial 3", "--radial"},
        {2, 1, "calibrate nothing:", "unknown source"},
        {1, 0, "calibrate --convert no-such-file", "no-such-file"},
        {1, 1, "calibrate 'sim:studio?frames=2&width=64&height=48'", "no frame shows a tag"},
        {1, 0, "calibrate sim:studio -o no/such/folder/camera.json", "no/such/folder"},
        {0, 0, "calibrate --help", "--no-tangential"},
    };
    sf_context *ctx = test_context();
    int tags = have_tags(ctx);
    sf_context_destroy(&ctx);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *said;
        if (cases[i].needs_tags && !tags) continue;
        int code = run_program(cases[i].arguments, &said);
        test_assert_contains(said, cases[i].says, __FILE__, __LINE__);
        assert_int_equal(code, cases[i].code);
        free(said);
    }
}

static void test_convert_command(void **state) {
    (void)state;
    static const char camera[] = "1 RADIAL 640 480 600.5 320 240 0.1 -0.02\n";
    sf_context *ctx = test_context();
    sf_calibration c;
    char arguments[2048], *said;
    test_write(test_path("cameras.txt"), camera, sizeof camera - 1);
    snprintf(arguments, sizeof arguments, "calibrate --convert %s -o %s", test_path("cameras.txt"),
             test_path("converted.json"));
    assert_int_equal(run_program(arguments, &said), 0);
    test_assert_contains(said, "600.500 px", __FILE__, __LINE__);
    free(said);
    assert_ok(ctx, sf_calibration_load(ctx, test_path("converted.json"), &c));
    assert_true(c.lens.fy == 600.5 && c.lens.k2 == -0.02 && c.width == 640);
    snprintf(arguments, sizeof arguments, "calibrate --convert %s -o -", test_path("cameras.txt"));
    assert_int_equal(run_program(arguments, &said), 0);
    test_write(test_path("said.json"), said, strlen(said)); /* nothing but the calibration */
    assert_ok(ctx, sf_calibration_load(ctx, test_path("said.json"), &c));
    free(said);
    sf_context_destroy(&ctx);
}

/* Each allocation in turn gives nothing: SF_ERR_MEMORY, and nothing is left behind. */
static sf_status whole_calibration(sf_context *ctx) {
    sf_board *board = NULL;
    sf_observations *observations = NULL;
    sf_calibration c;
    sf_pose pose;
    sf_board_corner corners[MOST_CORNERS];
    sf_status status = sf_board_open(ctx, "a4-36h11", 0, &board);
    if (!status) status = sf_observations_create(ctx, WIDTH, HEIGHT, &observations);
    for (int i = 0; i < 5 && !status; i++) {
        sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[i]);
        size_t n = calibrate_project_board(board, &calibrate_truth, &T, 0, NULL, corners);
        status = sf_observations_add(observations, corners, n);
        if (!status && i == 4) status = sf_board_pose(ctx, &calibrate_truth, corners, n, &pose);
    }
    if (!status) status = sf_calibrate(observations, NULL, &c);
    if (!status) status = sf_calibration_save(ctx, &c, test_path("memory.json"));
    if (!status) status = sf_calibration_load(ctx, test_path("memory.json"), &c);
    sf_observations_destroy(&observations);
    sf_board_close(&board);
    return status;
}

static void test_each_allocation_may_fail(void **state) {
    (void)state;
    sf_status status = SF_ERR_MEMORY;
    long failed = 0;
    for (long at = 1; status == SF_ERR_MEMORY && at < 200; at++) {
        test_allocations memory = {0};
        sf_allocator allocator = {test_count_alloc, test_count_free, &memory};
        sf_context_options options = {.allocator = &allocator, .threads = 1};
        sf_context *ctx = NULL;
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        memory.fail_at = atomic_load(&memory.calls) + at;
        status = whole_calibration(ctx);
        failed += status == SF_ERR_MEMORY;
        sf_context_destroy(&ctx);
        assert_int_equal(atomic_load(&memory.live), 0);
    }
    assert_int_equal(status, SF_OK);
    assert_true(failed > 8);
}

/* Photographs: 99 frames of a camera held over a board of 4 x 3 tags, of which the eighth is hidden. */

/* The board as it lies there: sides of 95.5 mm, 120.4 mm apart. */
static sf_board *real_board(sf_context *ctx) {
    char text[2048] = "{\"name\": \"tagboard\", \"tag_size_m\": 0.0955, \"tags\": [";
    sf_board *board;
    for (int id = 0; id < 12; id++) {
        size_t used = strlen(text);
        snprintf(text + used, sizeof text - used, "%s{\"id\": %d, \"x_m\": %.4f, \"y_m\": %.4f}",
                 id ? ", " : "", id, id % 4 * 0.1204, id / 4 * 0.1204);
    }
    strcat(text, "]}");
    test_write(test_path("tagboard.json"), text, strlen(text));
    assert_ok(ctx, sf_board_open(ctx, test_path("tagboard.json"), 0, &board));
    assert_int_equal(board->count, 12);
    return board;
}

static void print_real(const char *what, const sf_calibration *c) {
    print_message(
        "%s: reprojection error %.3f px rms, worst view %.3f px; %zu views (%zu rejected), %zu corners (%zu "
        "rejected), tilts of up to %.1f degrees, %.1f apart; fx %.2f (+-%.2f) fy %.2f cx %.2f cy %.2f k1 "
        "%.4f (+-%.4f)\n",
        what, c->rms, c->worst_rms, c->views, c->views_rejected, c->corners, c->corners_rejected,
        c->tilt_most, c->tilt_spread, c->lens.fx, c->sigma.fx, c->lens.fy, c->lens.cx, c->lens.cy, c->lens.k1,
        c->sigma.k1);
}

static size_t see_photograph(sf_context *ctx, sf_detector *detector, const char *path,
                             const sf_board_corner **corners) {
    sf_picture picture;
    size_t count;
    assert_ok(ctx, sf_picture_load(ctx, path, &picture));
    size_t pixels = (size_t)picture.width * (size_t)picture.height;
    for (size_t i = 0; i < pixels; i++)
        picture.rgb[i] =
            (uint8_t)((picture.rgb[i] + 2 * picture.rgb[i + pixels] + picture.rgb[i + 2 * pixels] + 2) / 4);
    assert_int_equal(picture.width, WIDTH);
    assert_int_equal(picture.height, HEIGHT);
    assert_ok(ctx, sf_detector_find(detector, picture.rgb, WIDTH, WIDTH, HEIGHT, corners, &count));
    sf_picture_free(ctx, &picture);
    return count;
}

static void test_photographs(void **state) {
    (void)state;
    char path[1024];
    const char *data = test_data();
    sf_context *ctx = test_context();
    if (!have_tags(ctx)) {
        sf_context_destroy(&ctx);
        test_skip("not built with libapriltag");
    }
    sf_board *board = real_board(ctx);
    sf_detector *detector;
    sf_observations *observations;
    sf_calibration c;
    const sf_lens factory = {607.178, 607.234, 321.391, 241.918, 0, 0, 0, 0, 0};
    double squares = 0, poses = 0;
    assert_ok(ctx, sf_detector_create(ctx, board, 1, &detector));
    assert_ok(ctx, sf_observations_create(ctx, WIDTH, HEIGHT, &observations));
    for (int i = 0; i < 99; i++) {
        const sf_board_corner *corners;
        sf_pose pose;
        snprintf(path, sizeof path, "%s/rbt-tagboard/images/frame_%04d.jpg", data, i);
        size_t n = see_photograph(ctx, detector, path, &corners);
        if (n < 16) continue;
        assert_ok(ctx, sf_observations_add(observations, corners, n));
        assert_ok(ctx, sf_board_pose(ctx, &factory, corners, n, &pose));
        squares += pose.rms * pose.rms;
        poses++;
    }
    print_message("%.0f photographs: poses through the factory's lens: %.3f px rms\n", poses,
                  sqrt(squares / poses));
    assert_int_equal(poses, 99);
    assert_true(sqrt(squares / poses) < 0.8);
    /* One focal length and k1: more cannot be told by tilts within nine degrees, as is said. */
    sf_calibrate_options o = {.fix_aspect = 1, .fix_center = 1, .radial = 1};
    test_log_clear();
    assert_ok(ctx, sf_calibrate(observations, &o, &c));
    print_real("focal length and k1", &c);
    assert_non_null(strstr(test_log, "the tilts of the views differ by"));
    assert_true(c.rms < 0.45 && c.worst_rms < 0.9);
    assert_true(fabs(c.lens.fx / factory.fx - 1) < 0.05);
    assert_true(c.views >= 90 && c.corners_rejected < c.corners / 10);
    assert_true(c.rms < 0.3);
    assert_status(ctx, sf_calibrate(observations, NULL, &c), SF_ERR_EMPTY);
    test_assert_contains(sf_last_error(ctx), "leave the lens open", __FILE__, __LINE__);
    sf_observations_destroy(&observations);
    sf_detector_destroy(&detector);
    sf_board_close(&board);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_swollen_edges),
        cmocka_unit_test(test_rendered_boards),
        cmocka_unit_test(test_commands),
        cmocka_unit_test(test_convert_command),
        cmocka_unit_test(test_each_allocation_may_fail),
        cmocka_unit_test(test_photographs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
