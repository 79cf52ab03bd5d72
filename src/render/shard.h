/* shard.h - a render of one view by several ranks (src/cluster/README.md).
 *
 * Each rank has a part of the Gaussians and draws a band of the picture's rows of tiles. Between project and
 * bin the projected Gaussians go to the ranks whose bands they touch; after the backward pass of blending
 * their sums come back. Meanwhile the workspace's arrays of Gaussians are those of the band.
 */
#ifndef SF_RENDER_SHARD_H
#define SF_RENDER_SHARD_H

#include "workspace.h"

/* A part of the workspace: the arrays of Gaussians that stages from bin to blend_bwd use. */
typedef struct sf_drawn_arrays {
    size_t count, capacity;
    sf_splat *splats;
    uint8_t *state, *in_view;
    uint16_t *first_row, *rows;
    uint32_t *span_offset, *slot;
    float *depth_of;
} sf_drawn_arrays;

typedef struct sf_shard {
    sf_drawn_arrays other; /* the band's, or this rank's own while the workspace has the band's */
    int drawing;           /* the workspace has the band's */
    /* of the present view */
    uint32_t *band_begin;   /* [ranks + 1] first row of tiles of each rank's band */
    size_t *send, *receive; /* [ranks] projected Gaussians */
    double *work;           /* [rows of tiles] */
    uint32_t *counts;       /* [ranks][3][rows of tiles] */
    size_t rows_capacity;
    char *outgoing, *incoming; /* what is exchanged */
    size_t outgoing_capacity, incoming_capacity;
    size_t *ranges; /* [4 ranks] scratch */
} sf_shard;

/* Bytes of what travels of a Gaussian: to a band that it touches, besides its rows, and back, unless that is
 * all zero. */
enum { SF_SHARD_SENT = 33, SF_SHARD_RETURNED = 27 };

/* Calls for each band that Gaussian i touches, in the order of the ranks. */
#define SF_FOR_BANDS(ws, s, n, i, r, begin, end)                                                             \
    for (size_t r = 0, begin, end; r < (n); r++)                                                             \
        if ((begin = (s)->band_begin[r], end = (s)->band_begin[r + 1], begin < end) &&                       \
            (ws)->first_row[i] < end && (size_t)(ws)->first_row[i] + (ws)->rows[i] > begin)

/* Makes the workspace share its renders with the other ranks of the context's cluster. SF_ERR_MEMORY. */
sf_status sf_shard_create(sf_workspace *ws);
/* Before sf_workspace_free: frees the arrays, but not what says that renders are shared. */
void sf_shard_empty(sf_workspace *ws);
void sf_shard_destroy(sf_workspace *ws);

/* All of these do nothing in a workspace that shares nothing. */

/* Before project: this rank's own Gaussians. */
void sf_shard_begin(sf_workspace *ws);
/* After project: sends projected Gaussians to the bands and takes up those of this rank's. */
sf_status sf_shard_send(sf_workspace *ws);
/* After blend: the whole picture on every rank, or, where ws->band_only, the rows around the band that the
 * loss reads. */
void sf_shard_picture(sf_workspace *ws, int with_depth);
/* shard_return.c: after the slots were filled: the sums of each own Gaussian, one slot a band. */
sf_status sf_shard_return(sf_workspace *ws);

/* A byte of each own Gaussian to the bands that it touches: *drawn, of those that this rank draws, grown to
 * at least their number; without a shard a copy. SF_ERR_MEMORY. */
sf_status sf_shard_flags(const sf_workspace *ws, const uint8_t *own, uint8_t **drawn, size_t *capacity);
/* Changes the workspace's arrays for the others. */
void sf_shard_swap(sf_workspace *ws);

/* Rows of pixels of the part of the picture that this rank works on: the band where ws->band_only, else all.
 */
void sf_shard_rows(const sf_workspace *ws, size_t *first, size_t *end);
/* Rows of pixels that the loss of that part reads: where ws->band_only those around the band, too. */
void sf_shard_loss_rows(const sf_workspace *ws, size_t *first, size_t *end);
/* The same for rows of tiles that it draws. */
void sf_shard_tile_rows(const sf_workspace *ws, size_t *first, size_t *end);
/* This rank's own Gaussians as they were projected; returns how many. */
size_t sf_shard_own(const sf_workspace *ws, const sf_splat **splats, const uint8_t **state);
/* Sums over the ranks what each has of its band; whole pictures are left alone. */
void sf_shard_sum(const sf_workspace *ws, double *values, size_t n);

#endif
