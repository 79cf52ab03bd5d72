/* start.h - the start of a live fit from pictures alone: frames are collected until they give a first map,
 * and are then handled again, with poses. */
#ifndef SF_LIVE_START_H
#define SF_LIVE_START_H

#include "first_map.h"
#include "frame_grabber.h"

/* A frame that was collected. */
typedef struct sf_start_frame {
    sf_picture picture; /* planes: NULL until it is handled again */
    uint8_t *rgb;       /* [height][width][3] */
    sf_features features;
    double moved;    /* from the frame before: the median way of a feature, in widths of the picture */
    uint64_t number; /* as sf_live_frame has it */
} sf_start_frame;

typedef struct sf_start {
    sf_context *ctx;
    sf_start_frame frames[SF_FIRST_MAP_MOST];
    size_t count;
    sf_frame_matches matches;
    size_t news;      /* frames since the last attempt */
    int strangers;    /* frames one after another that show another place than those collected */
    sf_first_map map; /* of the last attempt */
    double focal;     /* px: that the last attempt found; 0: none */
    size_t next;      /* with a map: the frame to be handled next, up to count */
    float *planes;    /* of the frame that is handled */
    size_t capacity;  /* floats */
} sf_start;

/* Takes the frame with this number, whose pose nobody knows, and tries to find a map when some have come.
 * lens: of the pictures, where it is known; NULL: it is to be found. *found: there is a map. SF_ERR_MEMORY.
 */
sf_status sf_start_take(sf_start *start, const sf_picture *picture, uint64_t number, const sf_lens *lens,
                        int *found);

/* Whether frames wait to be handled again. */
int sf_start_is_ready(const sf_start *start);

/* The next frame to be handled again, until the next call; after the last one all are forgotten, and *picture
 * is NULL. SF_ERR_MEMORY. */
sf_status sf_start_next(sf_start *start, const sf_picture **picture, uint64_t *number, sf_rigid *pose);

/* Forgets all frames, and what they told. */
void sf_start_clear(sf_start *start);
void sf_start_free(sf_start *start);

#endif
