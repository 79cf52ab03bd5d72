/* point_spawner.h - a thread that matches keyframes to find points for new Gaussians. */
#ifndef SF_LIVE_POINT_SPAWNER_H
#define SF_LIVE_POINT_SPAWNER_H

#include "../scene/sweep.h"

enum { SF_SPAWN_VIEWS = 6 };

typedef struct sf_spawner sf_spawner;

/* Points, how large each is to be, and the views that they are from. */
typedef struct sf_spawned_points {
    sf_cloud cloud;
    float *radius;                /* [n], world units; 0: not to be used */
    uint32_t ids[SF_SPAWN_VIEWS]; /* of the views that were searched, that camera's first */
} sf_spawned_points;

/* The spawner of a live fit, and what it led to. */
typedef struct sf_spawning {
    sf_spawner *spawner;
    size_t spawned; /* Gaussians so far */
} sf_spawning;

sf_status sf_spawner_create(sf_context *ctx, sf_spawner **spawner);
/* Waits for the search that is going on. */
void sf_spawner_destroy(sf_spawner **spawner);
/* Whether it has nothing to do, and nothing to give. */
int sf_spawner_idle(sf_spawner *spawner);
/* Begins a search among the views, of whose references it takes its own; only where it is idle. */
void sf_spawner_search(sf_spawner *spawner, sf_view *const *views, size_t n, const sf_sweep_options *options);
/* Waits for the search to end. */
void sf_spawner_wait(sf_spawner *spawner);
/* What was found; 0: nothing yet. The caller's to sf_spawned_points_free. */
int sf_spawner_take(sf_spawner *spawner, sf_spawned_points *points);
void sf_spawned_points_free(sf_spawner *spawner, sf_spawned_points *points);

#endif
