/* first_map.h - the first map of a live fit from pictures alone: the poses of frames, and the lens where
 * nobody knows it. The stages of src/sfm, in memory. */
#ifndef SF_LIVE_FIRST_MAP_H
#define SF_LIVE_FIRST_MAP_H

#include <splatfit/calibrate.h>

#include "../pose/rigid.h"
#include "../sfm/match.h"

/* What the frames tell. */
typedef enum sf_first_map_verdict {
    SF_FIRST_MAP_FEW,      /* too little is alike in them: a blank wall, blur, darkness */
    SF_FIRST_MAP_STILL,    /* the camera stands or turns in one place, or has hardly moved yet */
    SF_FIRST_MAP_FLAT,     /* all that they show may lie in one plane */
    SF_FIRST_MAP_MOVING,   /* they do not show one rigid scene: something large moves in them */
    SF_FIRST_MAP_DOUBTFUL, /* a map comes out of them, but it is not accurate enough yet */
    SF_FIRST_MAP_FOUND     /* the poses are known */
} sf_first_map_verdict;

enum { SF_FIRST_MAP_MOST = 24 }; /* frames */

/* Matches of the frames a < b are at [a][b]. */
typedef sf_matches sf_frame_matches[SF_FIRST_MAP_MOST][SF_FIRST_MAP_MOST];

/* Frames of one camera, in the order in which they came. */
typedef struct sf_first_map_input {
    int32_t width, height;       /* px, of the pictures */
    sf_lens lens;                /* px; where it is not known, what the search begins with */
    int is_lens_known;           /* 1: the lens stays as it is */
    size_t count;                /* 2..SF_FIRST_MAP_MOST */
    const sf_features *features; /* [count]: positions in px of the pictures */
    sf_frame_matches *matches;
} sf_first_map_input;

typedef struct sf_first_map {
    sf_first_map_verdict verdict; /* all below is valid where it is SF_FIRST_MAP_FOUND */
    sf_lens lens;                 /* as given or as found: one focal length, up to two radial parameters */
    uint8_t is_placed[SF_FIRST_MAP_MOST];
    sf_rigid
        poses[SF_FIRST_MAP_MOST]; /* of those that are placed, world to camera: the first of them stands at
                                     the origin, looks along +z, and sees points at a median depth of 1 */
    size_t placed, points;
    double used;         /* the part of what matches in placed frames that points were made from */
    double error, angle; /* px: root mean square distance of points from where they are seen; rad: the median
                            over the points of the widest angle between two rays to it */
} sf_first_map;

/* Finds the poses. The same bytes for any number of threads. SF_ERR_MEMORY. */
sf_status sf_first_map_find(sf_context *ctx, const sf_first_map_input *input, sf_first_map *map);

#endif
