/* paint.h - what the surfaces of the simulated scene are painted with. */
#ifndef SF_SIM_PAINT_H
#define SF_SIM_PAINT_H

#include <stdint.h>

#include "vec3.h"

typedef enum sf_paint {
    SF_PAINT_TILES,     /* chequered floor with small inlays */
    SF_PAINT_BRICKS,    /* brick wall with posters */
    SF_PAINT_SHELVES,   /* a wall of books */
    SF_PAINT_WALLPAPER, /* diamonds above panels, with an eye chart */
    SF_PAINT_CEILING,
    SF_PAINT_PARQUET,
    SF_PAINT_CRATE,
    SF_PAINT_GLAZE, /* plain and even: its detail is what it reflects */
    SF_PAINT_STEEL,
    SF_PAINT_GLOBE,
    SF_PAINT_DOTS,
    SF_PAINT_STRIPES,
    SF_PAINT_TARTAN,
    SF_PAINT_DIE,
    SF_PAINT_BLOCK, /* a toy block: a framed letter on each face */
    SF_PAINT_BOOK,
    SF_PAINT_BOARD /* a printed board of AprilTags on its upper face (sheet.h), as wide as that */
} sf_paint;

/* A place on a surface. */
typedef struct sf_spot {
    sf_vec3 local; /* in the object's frame, from its centre, world units */
    double u, v;   /* on a flat face: right and up as seen from the front, from its middle, world units */
    double hu, hv; /* half the face's width and height; 0 on a sphere */
    int face;      /* 0..5: +x -x +y -y +z -z; 0 on a sphere */
    uint32_t salt; /* tells objects of one paint apart */
} sf_spot;

/* The part of the light that the surface scatters, linear, each channel 0..1. */
sf_vec3 sf_paint_albedo(sf_paint paint, const sf_spot *spot);

#endif
