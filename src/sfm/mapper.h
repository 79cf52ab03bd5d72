/* mapper.h - poses, lenses and points from keypoints and verified matches (GEOMETRY.md, S.24). */
#ifndef SF_SFM_MAPPER_H
#define SF_SFM_MAPPER_H

#include "map.h"

/* Called after each picture that is placed. Not 0: the mapper stops. */
typedef int (*sf_mapper_progress)(void *user, size_t placed, size_t pictures);

/* Makes a map of the pictures that are not left out, from the pair that promises most on, picture by picture;
 * which are placed is in the map's pictures. Where the pictures show several places that nothing connects, it
 * is the map with most pictures; other_maps and other_pictures tell of the rest. progress may be NULL. The
 * same bytes for any number of threads. SF_ERR_EMPTY: no pair can begin a map (sf_last_error says why);
 * SF_ERR_CANCELLED; SF_ERR_MEMORY. *map is NULL on failure. */
sf_status sf_mapper_run(sf_context *ctx, const sf_map_input *input, const sf_map_options *options,
                        sf_mapper_progress progress, void *user, sf_map **map);

#endif
