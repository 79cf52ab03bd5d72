/* pose_graph.h - poses that agree best with what is known of the ways between them (README, P.10). */
#ifndef SF_POSE_POSE_GRAPH_H
#define SF_POSE_POSE_GRAPH_H

#include "../base/context.h"
#include "track.h"

/* Of a similarity's left twist: rho, phi, and the logarithm of the scale. */
enum { SF_SIMILAR_TWIST = SF_TWIST + 1 };

/* p' = scale R p + t */
typedef struct sf_similar {
    double scale;
    sf_rigid rigid;
} sf_similar;

void sf_similar_apply(const sf_similar *S, const double at[3], double to[3]);
/* c(p) = a(b(p)). c may be a or b. */
void sf_similar_compose(const sf_similar *a, const sf_similar *b, sf_similar *c);
void sf_similar_invert(const sf_similar *a, sf_similar *inverse);
/* S = (exp(sigma) exp(phi), rho) S for the twist (rho, phi, sigma). */
void sf_similar_move(sf_similar *S, const double twist[SF_SIMILAR_TWIST]);

/* A pose takes the world to a camera whose unit of length is `scale` times the world's. */
typedef struct sf_graph_pose {
    sf_similar at;
    int is_fixed;         /* stays as it is */
    int is_known;         /* prior holds, at a scale of 1 */
    sf_track_prior prior; /* as in a bundle */
} sf_graph_pose;

/* Pose a is `way` after pose b, with these inverse variances: of a radian, of a unit of length, of the
 * logarithm of the scale. */
typedef struct sf_graph_edge {
    uint32_t a, b;
    sf_similar way;
    double turn, move, scale;
} sf_graph_edge;

typedef struct sf_pose_graph {
    sf_graph_pose *poses;
    size_t pose_count;
    const sf_graph_edge *edges;
    size_t edge_count;
    int with_scale; /* 0: scales stay as they are */
} sf_pose_graph;

/* Moves the poses to where the weighted squares of the residuals are least, by Gauss and Newton, damped where
 * that does not lower them, `rounds` times at most. Each connected part needs a pose that is fixed or known.
 * *cost (may be NULL): half the sum. On failure all stay as they were. SF_ERR_MEMORY; SF_ERR_EMPTY: the
 * equations have no solution. */
sf_status sf_pose_graph_adjust(sf_context *ctx, const sf_pose_graph *graph, int rounds, double *cost);

/* The residual of an edge, of a after `way` of b: rho, phi, sigma of S_a (way S_b)^-1; and its derivatives by
 * the left twists of both, [7][7], row-major (may be NULL). */
void sf_graph_residual(const sf_similar *a, const sf_similar *b, const sf_similar *way,
                       double r[SF_SIMILAR_TWIST], double *by_a, double *by_b);

#endif
