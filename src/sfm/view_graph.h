/* view_graph.h - pairs whose rotation contradicts that of stronger pairs (GEOMETRY.md, S.29). */
#ifndef SF_SFM_VIEW_GRAPH_H
#define SF_SFM_VIEW_GRAPH_H

#include "tracks.h"

/* Repeated patterns, as of tiles, wallpaper or windows, give pictures of different places matches that agree
 * with a geometry, which is wrong. Estimates the rotations of all pictures [picture_count] from the pairs
 * that have a pose, and sets the count of each pair that contradicts them to 0. Such a pair is weaker than
 * every pair of another chain between its two pictures. *dropped: how many were. SF_ERR_MEMORY: pairs are as
 * they were. */
sf_status sf_view_graph_filter(sf_context *ctx, size_t picture_count, sf_matched_pair *pairs,
                               size_t pair_count, size_t *dropped);

#endif
