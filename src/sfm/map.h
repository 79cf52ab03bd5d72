/* map.h - a map that grows: pictures with poses, and tracks with points (GEOMETRY.md, S.24 to S.27). */
#ifndef SF_SFM_MAP_H
#define SF_SFM_MAP_H

#include <stddef.h>
#include <stdint.h>

#include "../base/context.h"
#include "../pose/bundle.h"
#include "tracks.h"
#include "triangulate.h"

/* A lens that pictures share. */
typedef struct sf_map_camera {
    int32_t width, height; /* px */
    sf_lens lens;          /* to begin with; then as estimated */
    int is_fixed;          /* the lens is known, and stays */
    int radial; /* by the map: radial parameters that are estimated at most, of those of its options */
    double focal_prior; /* px: what is known of fx (0: nothing), */
    double focal_sigma; /* and how well, as a part of it */
    int is_doubtful;    /* the prior is what files say: pictures may overrule it, which makes it 0 */
    double focal_voted; /* px: what pairs of pictures say of fx where the prior is doubtful (0: nothing) */
    double focal_told;  /* px: what files say of fx (0: nothing) */
    double
        unit; /* px: the unit of errors, a pixel of the reduced photo in which features were found (0: 1) */
    int is_vague; /* pairs say the same of a much longer focal length as of the one voted */
} sf_map_camera;

typedef struct sf_map_picture {
    const double *keypoints; /* [count][2], px */
    size_t count;
    uint32_t camera;
    uint32_t *track_of; /* [count]; UINT32_MAX: of none */
    int is_left_out;    /* by the caller: it is not looked at */
    int is_placed;
    int is_elsewhere; /* it is in a smaller map, of another place */
    sf_rigid pose;    /* world to camera */
    size_t tried_at;  /* points that it saw when it could last not be placed */
} sf_map_picture;

typedef struct sf_map_options {
    double error_px; /* the greatest distance of an inlier from where its point should be seen, in the unit of
                        the camera */
    double least_angle; /* rad: the widest angle at a point must be above */
    size_t least_seen;  /* points that a picture must see to be placed */
    size_t first_count; /* points that the first pair must have */
    int radial;         /* 0..2: radial parameters of a lens that are estimated once there are views enough */
    uint64_t seed;
} sf_map_options;

typedef struct sf_map {
    sf_context *ctx;
    sf_map_options options;
    sf_map_camera *cameras;
    size_t camera_count;
    sf_map_picture *pictures;
    size_t picture_count, placed_count;
    sf_tracks tracks;
    double (*at)[3];                   /* [tracks]: world */
    uint8_t *has_point;                /* [tracks] */
    uint8_t *is_used;                  /* [observations]: the point was made from it */
    size_t other_maps, other_pictures; /* maps of other places, and the pictures that they had */
    double spread;                     /* px: of a residual's coordinate, by the last bundle */
} sf_map;

/* What a map is made from; the caller's, and kept until the map is destroyed. Of pictures: keypoints, count,
 * camera and is_left_out. */
typedef struct sf_map_input {
    const sf_map_camera *cameras;
    size_t camera_count;
    const sf_map_picture *pictures;
    size_t picture_count;
    const sf_matched_pair *pairs;
    size_t pair_count;
} sf_map_input;

/* A map without points or placed pictures, its tracks made. SF_ERR_MEMORY: *map is NULL. */
sf_status sf_map_create(sf_context *ctx, const sf_map_input *input, const sf_map_options *options,
                        sf_map **map);
void sf_map_destroy(sf_map **map);

/* Back to how it was created. */
void sf_map_clear(sf_map *map, const sf_map_input *input);

/* error 4 px, angle 1.5 degrees, 15 points seen, 60 of the first pair, radial 2, seed 1. */
sf_map_options sf_map_options_default(void);

/* 1. map_points.c */

double sf_map_unit(const sf_map_camera *camera);

/* The observation as a camera that sees it, without its ray; 0: its picture is not placed. */
int sf_map_observe(const sf_map *map, size_t observation, sf_sight *sight);

/* Gives points to tracks without one that placed pictures see, and uses further observations for those that
 * have one. picture: only tracks that this one sees; SIZE_MAX: all. */
void sf_map_make_points(sf_map *map, size_t picture);

/* Drops observations with an error above `most` px, and points that less than two are left of, or whose angle
 * is too small; picture as above. *dropped: observations. SF_ERR_MEMORY. */
sf_status sf_map_drop_bad(sf_map *map, size_t picture, size_t *dropped);

/* Points, and observations of them that are used, in placed pictures. */
size_t sf_map_count_points(const sf_map *map, size_t *observations);

/* 2. map_place.c */

/* Points that a picture would see; *cells (may be NULL): of the picture's 16 x 16, those with one. */
size_t sf_map_count_seen(const sf_map *map, size_t picture, size_t *cells);

/* Places a picture by the points that it sees. 0: it cannot be. SF_ERR_MEMORY. */
sf_status sf_map_place(sf_map *map, size_t picture, int *is_placed);

/* 3. map_bundle.c */

/* Adjusts all poses, points and lenses; rounds at most. The first placed picture stays. */
sf_status sf_map_adjust(sf_map *map, int rounds, double enough);

/* The same by each n-th track's point, and by more of pictures that would have too few; the others stay. */
sf_status sf_map_adjust_sample(sf_map *map, size_t each, int rounds, double enough);

/* As sf_map_adjust, but poses and lenses by a part of the points; then all points are adjusted, while the
 * poses stay. Quicker, for maps that are not finished. */
sf_status sf_map_adjust_roughly(sf_map *map, int rounds, double enough);

/* Adjusts the poses of a picture and of those `most` that share most points with it, and these points. */
sf_status sf_map_adjust_around(sf_map *map, size_t picture, size_t most);

/* 4. map_lens.c */

/* Leaves to each lens as few radial parameters as explain its pictures as well: the others become 0. An
 * adjustment of all is to follow. SF_ERR_MEMORY: the map is to be destroyed. */
sf_status sf_map_choose_lens(sf_map *map);

#endif
