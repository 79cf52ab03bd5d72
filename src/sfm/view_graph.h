/* view_graph.h - pairs whose rotation contradicts that of stronger pairs (GEOMETRY.md, S.29). */
#ifndef SF_SFM_VIEW_GRAPH_H
#define SF_SFM_VIEW_GRAPH_H

#include "tracks.h"

/* Repeated patterns, as of tiles, wallpaper or windows, give matches between pictures of different places,
 * which agree with a geometry that is wrong. Estimates the rotations of all pictures [picture_count] from the
 * pairs with a pose, and sets the count of pairs that contradict them to 0: for each such pair, each pair of
 * a chain that connects its pictures otherwise has more matches. *dropped: how many. SF_ERR_MEMORY: pairs are
 * as they were. */
sf_status sf_view_graph_filter(sf_context *ctx, size_t picture_count, sf_matched_pair *pairs,
                               size_t pair_count, size_t *dropped);

#endif
