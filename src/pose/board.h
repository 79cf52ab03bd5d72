/* board.h - the inside of boards: where their tags are, and how they are drawn. */
#ifndef SF_POSE_BOARD_H
#define SF_POSE_BOARD_H

#include "../base/file.h"

#include <splatfit/calibrate.h>

enum { SF_BOARD_MOST_TAGS = 600 };

/* The corners of an upright tag with its middle at x, y. */
sf_board_tag sf_board_place(int32_t id, double x, double y, double side, double angle);

/* A board's description as JSON. */
sf_status sf_board_save(sf_context *ctx, const sf_board *board, const char *path);

/* Drawings: black on white, mm, from the upper left corner of the sheet. */

typedef struct sf_bar {
    double x, y, width, height; /* upper left corner */
} sf_bar;

/* With round ends. */
typedef struct sf_stroke {
    double x0, y0, x1, y1, width;
} sf_stroke;

typedef struct sf_sketch {
    sf_context *ctx;
    const char *title;
    double width, height; /* of the sheet */
    sf_bar *bars;         /* may overlap: edges that touch would show as hairlines */
    sf_stroke *strokes;
    size_t bar_count, bar_capacity, stroke_count, stroke_capacity;
} sf_sketch;

sf_status sf_sketch_bar(sf_sketch *sketch, double x, double y, double width, double height);
/* Text of 0-9, A-Z (small letters are written as capitals) and a few signs; `height` of a capital, x and y
 * its lower left corner. */
sf_status sf_sketch_text(sf_sketch *sketch, const char *text, double x, double y, double height);
void sf_sketch_free(sf_sketch *sketch);

sf_status sf_sketch_svg(const sf_sketch *sketch, const char *path);
sf_status sf_sketch_pdf(const sf_sketch *sketch, const char *path);
sf_status sf_sketch_png(const sf_sketch *sketch, const char *path);

#endif
