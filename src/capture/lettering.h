/* lettering.h - capital letters drawn with strokes, for the surfaces of the simulated scene. */
#ifndef SF_CAPTURE_LETTERING_H
#define SF_CAPTURE_LETTERING_H

/* A line of text. Letters are 4 units wide, 6 high, 6 apart. */
typedef struct sf_line {
    const char *text; /* A-Z, 0-9 and spaces; anything else is left blank */
    double x, y;      /* lower left corner of the first letter */
    double unit;      /* size of a unit */
    double weight;    /* half the stroke's width, in units */
} sf_line;

/* Whether (x, y), in the line's own coordinates, lies on a stroke. */
int sf_lettering(const sf_line *line, double x, double y);

#endif
