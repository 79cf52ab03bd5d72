/* cli_fixture.h - the models and projects that the program is tried with. */
#ifndef TESTS_UNIT_CLI_FIXTURE_H
#define TESTS_UNIT_CLI_FIXTURE_H

#include "program.h"

enum { IMAGES = 4, POINTS = 12, PICTURE_WIDTH = 32, PICTURE_HEIGHT = 24, MARKS = 256 };

/* A file in the making. Each value begins at a mark. */
typedef struct buffer {
    uint8_t data[4096];
    size_t size, mark[MARKS];
    int marks;
} buffer;

/* What can be wrong with a COLMAP project. */
typedef struct plan {
    uint64_t cameras, images, points; /* counts that the files announce */
    uint64_t observations, track;     /* of the first image and the first point */
    uint64_t width, lens;             /* of the camera */
    uint64_t camera_of_image;
    double focal;
    double qw[IMAGES];
} plan;

/* A project with nothing wrong. */
plan cli_good_plan(void);

/* The files of its model: their names in the project, and their bytes. */
enum { CAMERAS_BIN, IMAGES_BIN, POINTS_BIN, BINS };
extern const char *const cli_bin_names[BINS];
void cli_make_bins(const plan *p, buffer bins[BINS]);

/* "<project>/<name>", relative to the work folder. */
const char *cli_in_project(const char *project, const char *name);

/* Writes the files of the model alone, and the whole project with its folders and pictures. */
void cli_write_bins(const char *project, const plan *p);
void cli_write_project(const char *project, const plan *p);

/* The name of picture i, relative to the work folder. */
const char *cli_picture_name(const char *project, int i);

/* A fit of one step, and the end of one of ten. */
#define FIT       "fit", SCENE, "-o", "out/x.ply", "--steps", "1"
#define SHORT_FIT SCENE, "--steps", "10", SMALL

/* The work folder with "good.ply" of 5 Gaussians, the project "good", and files and folders that are neither.
 */
int cli_set_up(void **state);

#endif
