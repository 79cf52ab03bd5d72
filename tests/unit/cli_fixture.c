/* cli_fixture.c - writes the models and projects into the work folder. */
#include "cli_fixture.h"

#include <stdio.h>
#include <string.h>

static void add_bytes(buffer *b, const void *data, size_t size) {
    assert_true(size <= sizeof b->data - b->size && b->marks < MARKS);
    b->mark[b->marks++] = b->size;
    memcpy(b->data + b->size, data, size);
    b->size += size;
}

static void add_uint(buffer *b, uint64_t v, size_t bytes) {
    uint8_t le[8];
    for (size_t i = 0; i < bytes; i++) le[i] = (uint8_t)(v >> (8 * i));
    add_bytes(b, le, bytes);
}

static void add_double(buffer *b, double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    add_uint(b, bits, 8);
}

plan cli_good_plan(void) {
    return (plan){.cameras = 1,
                  .images = IMAGES,
                  .points = POINTS,
                  .observations = 1,
                  .track = 1,
                  .width = PICTURE_WIDTH,
                  .lens = 1,
                  .camera_of_image = 1,
                  .focal = 30,
                  .qw = {1, 1, 1, 1}};
}

const char *const cli_bin_names[BINS] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                         "sparse/0/points3D.bin"};

void cli_make_bins(const plan *p, buffer bins[BINS]) {
    buffer *cameras = &bins[CAMERAS_BIN], *images = &bins[IMAGES_BIN], *points = &bins[POINTS_BIN];
    for (int i = 0; i < BINS; i++) bins[i].size = 0, bins[i].marks = 0;
    add_uint(cameras, p->cameras, 8);
    add_uint(cameras, 1, 4);
    add_uint(cameras, p->lens, 4);
    add_uint(cameras, p->width, 8);
    add_uint(cameras, PICTURE_HEIGHT, 8);
    const double lens[] = {p->focal, p->focal, PICTURE_WIDTH / 2.0, PICTURE_HEIGHT / 2.0};
    for (int i = 0; i < 4; i++) add_double(cameras, lens[i]);

    add_uint(images, p->images, 8);
    for (unsigned i = 0; i < IMAGES; i++) {
        const double pose[] = {p->qw[i], 0, 0, 0, 0.2 * i, -0.1 * i, 4};
        char name[] = "0.png";
        name[0] = (char)('0' + i);
        add_uint(images, i + 1, 4);
        for (int k = 0; k < 7; k++) add_double(images, pose[k]);
        add_uint(images, p->camera_of_image, 4);
        add_bytes(images, name, sizeof name);
        add_uint(images, i ? 0 : p->observations, 8);
        if (i) continue;
        add_double(images, 1.5);
        add_double(images, 2.5);
        add_uint(images, 1, 8);
    }

    add_uint(points, p->points, 8);
    for (unsigned i = 0; i < POINTS; i++) {
        const double xyz[] = {0.3 * (i % 3) - 0.3, 0.3 * (i / 3 % 3) - 0.3, 0.2 * (i % 2)};
        const uint8_t rgb[] = {200, (uint8_t)(20 * i), 40};
        add_uint(points, i + 1, 8);
        for (int k = 0; k < 3; k++) add_double(points, xyz[k]);
        add_bytes(points, rgb, 3);
        add_double(points, 0.5);
        add_uint(points, i ? 0 : p->track, 8);
        if (!i) add_uint(points, 1, 8);
    }
}

const char *cli_in_project(const char *project, const char *name) {
    static char paths[4][256];
    static unsigned turn;
    char *path = paths[turn++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", project, name);
    return path;
}

void cli_write_bins(const char *project, const plan *p) {
    static buffer bins[BINS];
    cli_make_bins(p, bins);
    for (int i = 0; i < BINS; i++)
        test_write(work(cli_in_project(project, cli_bin_names[i])), bins[i].data, bins[i].size);
}

const char *cli_picture_name(const char *project, int i) {
    char name[32];
    snprintf(name, sizeof name, "images/%d.png", i);
    return cli_in_project(project, name);
}

void cli_write_project(const char *project, const plan *p) {
    static const char *const folders[] = {"images", "sparse", "sparse/0"};
    float rgb[3 * PICTURE_WIDTH * PICTURE_HEIGHT];
    sf_context *ctx = test_context();
    make_folder(project);
    for (int i = 0; i < 3; i++) make_folder(cli_in_project(project, folders[i]));
    for (int i = 0; i < IMAGES; i++) {
        for (int k = 0; k < 3 * PICTURE_WIDTH * PICTURE_HEIGHT; k++)
            rgb[k] = (float)((k * (i + 3)) % 97) / 97;
        assert_ok(ctx,
                  sf_write_png(ctx, work(cli_picture_name(project, i)), PICTURE_WIDTH, PICTURE_HEIGHT, rgb));
    }
    sf_context_destroy(&ctx);
    cli_write_bins(project, p);
}

static void write_model(void) {
    sf_context *ctx = test_context();
    sf_model *model;
    float values[5 * 3];
    for (int i = 0; i < 15; i++) values[i] = 0.2f * (float)(i % 4);
    sf_gaussians from = {.means = values, .logit_opacities = values};
    assert_ok(ctx, sf_model_create(ctx, 5, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, 5, &from));
    assert_ok(ctx, sf_model_save(model, work("good.ply")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int cli_set_up(void **state) {
    if (program_set_up(state)) return -1;
    plan p = cli_good_plan();
    make_folder("empty");
    make_folder("empty.ply");
    write_text("file", "text\n");
    write_text("list", "nobody\n");
    write_model();
    cli_write_project("good", &p);
    return 0;
}
