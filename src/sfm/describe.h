/* describe.h - directions and descriptors of the points found in an octave (README.md, S.4 to S.6). */
#ifndef SF_SFM_DESCRIBE_H
#define SF_SFM_DESCRIBE_H

#include "band.h"
#include "feature_list.h"

/* A point of an octave. */
typedef struct sf_spot {
    float x, y; /* px of the octave; pixel (0, 0) has its middle there */
    float scale, response;
} sf_spot;

/* The points of one level that have no descriptors yet. */
typedef struct sf_spots {
    sf_spot *items;
    size_t count, capacity;
} sf_spots;

sf_status sf_spots_add(sf_context *ctx, sf_spots *spots, const sf_spot *spot);

/* Rows above and below a point of the greatest scale of an octave that its descriptor may see. */
enum { SF_DESCRIBE_REACH = 41 };

/* What is made of an octave's points. */
typedef struct sf_describe_args {
    const sf_kernels *kernels;
    int width, height; /* px of the octave */
    double step;       /* px of the picture a px of the octave */
    int directions;    /* a point may have at most */
    float *sums;       /* [SF_DESCRIPTOR][SF_LANES] scratch, aligned */
    sf_feature_list *list;
} sf_describe_args;

/* Describes the points whose surroundings the level's rows hold, and drops them from `spots`. SF_ERR_MEMORY.
 */
sf_status sf_describe(const sf_describe_args *args, const sf_band *level, sf_spots *spots);

#endif
