/* transforms_fixture.c - writes projects and loads them. */
#include "transforms_fixture.h"

#include <string.h>
#include <sys/stat.h>

void transforms_write_json(const char *project, const char *name, const char *text) {
    char json[TEXT_BYTES];
    size_t size = strlen(text);
    assert_true(size < sizeof json);
    for (size_t i = 0; i < size; i++) json[i] = text[i];
    for (size_t i = 0; i < size; i++)
        if (json[i] == '\'') json[i] = '"';
    test_write(test_path_in(project, name), json, size);
}

void transforms_write_picture(sf_context *ctx, const char *path, float level) {
    float rgb[3 * PIXELS];
    for (int i = 0; i < 3 * PIXELS; i++) rgb[i] = i % 3 ? level : (float)(i / 3) / PIXELS;
    assert_ok(ctx, sf_write_png(ctx, path, WIDTH, HEIGHT, rgb));
}

void transforms_make_project(sf_context *ctx, const char *project) {
    mkdir(test_path(project), 0777);
    mkdir(test_path_in(project, "images"), 0777);
    transforms_write_picture(ctx, test_path_in(project, "images/a.png"), 0.25f);
    transforms_write_picture(ctx, test_path_in(project, "images/b.png"), 0.5f);
    transforms_write_picture(ctx, test_path_in(project, "images/c.png"), 0.75f);
}

sf_load_options transforms_train_all(void) {
    sf_load_options options = sf_load_options_default();
    options.hold_out = 0;
    return options;
}

sf_scene *transforms_load_json(sf_context *ctx, const char *project, const char *text) {
    sf_load_options options = transforms_train_all();
    transforms_write_json(project, "transforms.json", text);
    return test_load_scene(ctx, test_path(project), &options);
}

void transforms_assert_refused(sf_context *ctx, const char *project, const char *text, sf_status expected,
                               const char *part) {
    sf_scene *scene;
    sf_load_options options = transforms_train_all();
    transforms_write_json(project, "transforms.json", text);
    assert_status(ctx, sf_scene_load(ctx, test_path(project), &options, &scene), expected);
    assert_null(scene);
    assert_error_names(ctx, part);
    assert_error_names(ctx, project);
}

void transforms_assert_log(const char *part) { test_assert_contains(test_log, part, __FILE__, __LINE__); }

const char transforms_one_point[] =
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n1 2 3\n";
