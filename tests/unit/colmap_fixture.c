/* colmap_fixture.c - writes the project: its models and its pictures. */
#include "colmap_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

const camera colmap_cameras[] = {
    {7, 1, "PINHOLE", WIDTH, HEIGHT, 4, {20, 21, 12.5, 8.25}},
    {2, 2, "SIMPLE_RADIAL", 2 * WIDTH, 2 * HEIGHT, 4, {40, 24, 16, -0.05}},
    {3, 0, "SIMPLE_PINHOLE", WIDTH, HEIGHT, 3, {19, 12, 8}},
};
const image colmap_images[] = {
    {4, 7, {1, 0, 0, 0}, {0.1, -0.2, 3}, "c.png", 2},
    {1, 2, {2, 0, 0, 2}, {1, 2, 3}, "b.png", 0}, /* a quarter turn around z, not normalised */
    {9, 3, {0.5, 0.5, -0.5, 0.5}, {0, 0, 1e-3}, "sub/a 1.png", 1},
    {5, 7, {0.1, -0.9, 0.3, 0.2}, {-4, 0.25, 1. / 3}, "a.png", 3},
};
static const double points[3][3] = {{1, 2, 3}, {-0.1, 1e-3, 7.25}, {4, 5, -6}};

static void add(buffer *b, const void *data, size_t size) {
    assert_true(size <= sizeof b->data - b->size);
    memcpy(b->data + b->size, data, size);
    b->size += size;
}

void colmap_add_uint(buffer *b, uint64_t v, int bytes) {
    for (int i = 0; i < bytes; i++) {
        uint8_t byte = (uint8_t)(v >> (8 * i));
        add(b, &byte, 1);
    }
}

void colmap_add_doubles(buffer *b, const double *v, int count) {
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &v[i], 8);
        colmap_add_uint(b, bits, 8);
    }
}

void colmap_add_camera(buffer *b, const camera *c) {
    colmap_add_uint(b, c->id, 4);
    colmap_add_uint(b, (uint64_t)c->model, 4);
    colmap_add_uint(b, (uint64_t)c->width, 8);
    colmap_add_uint(b, (uint64_t)c->height, 8);
    colmap_add_doubles(b, c->parameter, c->parameters);
}

void colmap_add_image(buffer *b, const image *v) {
    colmap_add_uint(b, v->id, 4);
    colmap_add_doubles(b, v->q, 4);
    colmap_add_doubles(b, v->t, 3);
    colmap_add_uint(b, v->camera, 4);
    add(b, v->name, strlen(v->name) + 1);
    colmap_add_uint(b, (uint64_t)v->observations, 8);
    for (int i = 0; i < v->observations; i++) {
        colmap_add_doubles(b, v->t, 2);
        colmap_add_uint(b, UINT64_MAX, 8);
    }
}

static void add_point(buffer *b, int i) {
    colmap_add_uint(b, (uint64_t)i + 1, 8);
    colmap_add_doubles(b, points[i], 3);
    for (int c = 0; c < 3; c++) colmap_add_uint(b, (uint64_t)(100 * i + c), 1);
    colmap_add_doubles(b, &points[0][0], 1);
    colmap_add_uint(b, (uint64_t)i, 8);
    for (int k = 0; k < i; k++) colmap_add_uint(b, 0x100000004, 8);
}

files colmap_binary_files(void) {
    files f = {.cameras.size = 0};
    colmap_add_uint(&f.cameras, CAMERAS, 8);
    for (int i = 0; i < CAMERAS; i++) colmap_add_camera(&f.cameras, &colmap_cameras[i]);
    colmap_add_uint(&f.images, IMAGES, 8);
    for (int i = 0; i < IMAGES; i++) colmap_add_image(&f.images, &colmap_images[i]);
    colmap_add_uint(&f.points, POINTS, 8);
    for (int i = 0; i < POINTS; i++) add_point(&f.points, i);
    return f;
}

static void print(buffer *b, const char *format, ...) {
    char line[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    add(b, line, strlen(line));
}

static void print_doubles(buffer *b, const double *v, int count) {
    for (int i = 0; i < count; i++) print(b, " %.17g", v[i]);
}

files colmap_text_files(void) {
    files f = {.cameras.size = 0};
    print(&f.cameras, "# Camera list with one line of data per camera:\n\n");
    for (int i = 0; i < CAMERAS; i++) {
        print(&f.cameras, "%u %s %.0f %.0f", colmap_cameras[i].id, colmap_cameras[i].model_name,
              colmap_cameras[i].width, colmap_cameras[i].height);
        print_doubles(&f.cameras, colmap_cameras[i].parameter, colmap_cameras[i].parameters);
        print(&f.cameras, "\r\n");
    }
    print(&f.images, "# Image list with two lines of data per image:\n");
    for (int i = 0; i < IMAGES; i++) {
        print(&f.images, "%u", colmap_images[i].id);
        print_doubles(&f.images, colmap_images[i].q, 4);
        print_doubles(&f.images, colmap_images[i].t, 3);
        print(&f.images, " %u %s\n", colmap_images[i].camera, colmap_images[i].name);
        for (int k = 0; k < colmap_images[i].observations; k++) print(&f.images, "1.5 2.5 -1 ");
        if (i < IMAGES - 1) print(&f.images, "\n"); /* the last line may lack its end */
    }
    print(&f.points, "# 3D point list with one line of data per point:\n");
    for (int i = 0; i < POINTS; i++) {
        print(&f.points, "%d", i + 1);
        print_doubles(&f.points, points[i], 3);
        print(&f.points, " %d %d %d 0.5 4 0\n", 100 * i, 100 * i + 1, 100 * i + 2);
    }
    return f;
}

void colmap_make_folder(const char *path) { assert_true(mkdir(path, 0777) == 0 || test_exists(path)); }

float colmap_shade(int picture, int i, int channel) {
    return (float)((37 * picture + 11 * i + 90 * channel) % 256) / 255;
}

void colmap_write_picture(sf_context *ctx, const char *path, int picture, int width, int height) {
    float *rgb = calloc((size_t)(width * height), 3 * sizeof *rgb);
    assert_non_null(rgb);
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = colmap_shade(picture, i / 3, i % 3);
    assert_ok(ctx, sf_write_png(ctx, path, width, height, rgb));
    free(rgb);
}

void colmap_write_pictures(sf_context *ctx, const char *project, const char *folder, int divisor) {
    char path[256];
    colmap_make_folder(test_path(project));
    colmap_make_folder(test_path_in(project, folder));
    snprintf(path, sizeof path, "%s/sub", folder);
    colmap_make_folder(test_path_in(project, path));
    for (int i = 0; i < IMAGES; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, colmap_images[i].name);
        colmap_write_picture(ctx, test_path_in(project, path), i, WIDTH / divisor, HEIGHT / divisor);
    }
}

void colmap_write_model(const char *project, const char *folder, const files *f, const char *ending) {
    char path[256];
    const buffer *all[] = {&f->cameras, &f->images, &f->points};
    const char *names[] = {"cameras", "images", "points3D"};
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s%s", folder, names[i], ending);
        test_write(test_path_in(project, path), all[i]->data, all[i]->size);
    }
}

const char *colmap_write_project(sf_context *ctx, const char *project) {
    files f = colmap_binary_files();
    colmap_write_pictures(ctx, project, "images", 1);
    colmap_make_folder(test_path_in(project, "sparse"));
    colmap_make_folder(test_path_in(project, "sparse/0"));
    colmap_write_model(project, "sparse/0/", &f, ".bin");
    return test_path(project);
}

void colmap_assert_refused_with(sf_context *ctx, const char *path, const sf_load_options *options,
                                sf_status expected, const char *part) {
    sf_scene *scene;
    assert_status(ctx, sf_scene_load(ctx, path, options, &scene), expected);
    assert_null(scene);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

void colmap_assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    colmap_assert_refused_with(ctx, path, NULL, expected, part);
}

void colmap_assert_log(const char *part) { test_assert_contains(test_log, part, __FILE__, __LINE__); }
