/* transforms_fixture.h - projects with a transforms.json, and its parts. */
#ifndef TESTS_UNIT_TRANSFORMS_FIXTURE_H
#define TESTS_UNIT_TRANSFORMS_FIXTURE_H

#include "testing.h"

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT, TEXT_BYTES = 8192 };

/* A pose, a lens and a frame, to be put together. */
#define IDENTITY            "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]"
#define LENS                "'w':24,'h':16,'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.25,"
#define FRAME(name, matrix) "{'file_path':'" name "','transform_matrix':" matrix "}"

/* Writes JSON that is spelled with ' for ". */
void transforms_write_json(const char *project, const char *name, const char *text);

/* Of WIDTH x HEIGHT pixels, green and blue of one level, 0..1. */
void transforms_write_picture(sf_context *ctx, const char *path, float level);

/* A folder with images/a.png, b.png and c.png. */
void transforms_make_project(sf_context *ctx, const char *project);

/* The defaults, but that no view is held out. */
sf_load_options transforms_train_all(void);

/* Writes transforms.json, whose views must load, all for training. */
sf_scene *transforms_load_json(sf_context *ctx, const char *project, const char *text);

/* Loading fails with this status, and the error names the project and `part`. */
void transforms_assert_refused(sf_context *ctx, const char *project, const char *text, sf_status expected,
                               const char *part);

/* The log holds `part`. */
void transforms_assert_log(const char *part);

/* A .ply file of the point 1, 2, 3. */
extern const char transforms_one_point[];

#define THREE_FRAMES                                                                                         \
    "'frames':[" FRAME("images/a.png", IDENTITY) "," FRAME("images/b.png", IDENTITY) "," FRAME(              \
        "images/c.png", IDENTITY) "]}"

#endif
