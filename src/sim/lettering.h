/* lettering.h - capital letters drawn with strokes, for the surfaces of the simulated scene and for boards.
 */
#ifndef SF_SIM_LETTERING_H
#define SF_SIM_LETTERING_H

/* In units. */
enum { SF_LETTER_HEIGHT = 6, SF_LETTER_PITCH = 6 };

/* A letter's strokes as runs of points "xy", x 0..4 to the right, y 0..6 upwards; a space lifts the pen. ""
 * for what is no letter: A-Z, 0-9 and .,:;-/% are. */
const char *sf_letter_strokes(char letter);

/* A line of text. Letters are 4 units wide, 6 high, 6 apart. */
typedef struct sf_line {
    const char *text; /* what has strokes; anything else is left blank */
    double x, y;      /* lower left corner of the first letter */
    double unit;      /* size of a unit */
    double weight;    /* half the stroke's width, in units */
} sf_line;

/* Whether (x, y), in the line's own coordinates, lies on a stroke. */
int sf_lettering(const sf_line *line, double x, double y);

#endif
