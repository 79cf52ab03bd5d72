/* lettering.c - capital letters drawn with strokes, for the surfaces of the simulated scene and for boards.
 */
#include "lettering.h"

#include <string.h>

#include "vec3.h"

const char *sf_letter_strokes(char letter) {
    static const char *const letters[26] = {
        "0004264440 0242",           /* A */
        "00063645443303 3342413000", /* B */
        "4536160501103041",          /* C */
        "00062644422000",            /* D */
        "46060040 0333",             /* E */
        "460600 0333",               /* F */
        "45361605011030414323",      /* G */
        "0006 4640 0343",            /* H */
        "1030 2026 1636",            /* I */
        "4641301001",                /* J */
        "0006 460340",               /* K */
        "060040",                    /* L */
        "0006234640",                /* M */
        "00064046",                  /* N */
        "103041453616050110",        /* O */
        "00063645443303",            /* P */
        "103041453616050110 2240",   /* Q */
        "00063645443303 2340",       /* R */
        "453616050413334241301001",  /* S */
        "0646 2620",                 /* T */
        "060110304146",              /* U */
        "062046",                    /* V */
        "0610233046",                /* W */
        "0046 0640",                 /* X */
        "0623 4623 2320",            /* Y */
        "06460040",                  /* Z */
    };
    static const char *const digits[10] = {
        "103041453616050110 1135",          /* 0 */
        "152620 1030",                      /* 1 */
        "05163645440040",                   /* 2 */
        "0516364544334241301001 1333",      /* 3 */
        "30360242",                         /* 4 */
        "460603334241301001",               /* 5 */
        "4536160501103041423303",           /* 6 */
        "064610",                           /* 7 */
        "13334445361605041302011030414233", /* 8 */
        "0110304145361605041343",           /* 9 */
    };
    static const char signs[] = ".,:;-/%";
    static const char *const sign_strokes[] = {
        "2021", "2110", "2122 2425", "2110 2425", "1333", "0046", "0046 0506161505 3031414030"};
    if (letter >= 'A' && letter <= 'Z') return letters[letter - 'A'];
    if (letter && strchr(signs, letter)) return sign_strokes[strchr(signs, letter) - signs];
    return letter >= '0' && letter <= '9' ? digits[letter - '0'] : "";
}

/* Squared distance from (x, y) to the segment between two points "xy". */
static double segment_distance2(const char *from, const char *to, double x, double y) {
    double ax = from[0] - '0', ay = from[1] - '0', bx = to[0] - '0' - ax, by = to[1] - '0' - ay;
    double t = ((x - ax) * bx + (y - ay) * by) / (bx * bx + by * by);
    t = lesser(greater(t, 0), 1);
    double dx = x - ax - t * bx, dy = y - ay - t * by;
    return dx * dx + dy * dy;
}

int sf_lettering(const sf_line *line, double x, double y) {
    double u = (x - line->x) / line->unit, v = (y - line->y) / line->unit;
    if (v < -line->weight || v > SF_LETTER_HEIGHT + line->weight || u < -1) return 0;
    int index = whole_below((u + 1) / SF_LETTER_PITCH);
    if ((size_t)index >= strlen(line->text)) return 0;
    u -= index * SF_LETTER_PITCH;
    for (const char *p = sf_letter_strokes(line->text[index]); *p; p += p[2] == ' ' ? 3 : 2) {
        if (!p[2]) break;
        if (p[2] != ' ' && segment_distance2(p, p + 2, u, v) < line->weight * line->weight) return 1;
    }
    return 0;
}
