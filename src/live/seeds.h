/* seeds.h - points by matching keyframes, found on a thread of its own. */
#ifndef SF_LIVE_SEEDS_H
#define SF_LIVE_SEEDS_H

#include "../scene/sweep.h"

enum { SF_SEED_VIEWS = 6 };

typedef struct sf_seeder sf_seeder;

/* Points, how large each is to be, and the views that they are from. */
typedef struct sf_seeds {
    sf_cloud cloud;
    float *radius;               /* [n], world units; 0: not to be used */
    uint32_t ids[SF_SEED_VIEWS]; /* of the views that were searched, that camera's first */
} sf_seeds;

sf_status sf_seeder_create(sf_context *ctx, sf_seeder **seeder);
/* Waits for the search that is going on. */
void sf_seeder_destroy(sf_seeder **seeder);
/* Whether it has nothing to do, and nothing to give. */
int sf_seeder_idle(sf_seeder *seeder);
/* Begins a search among the views, of whose references it takes its own; only where it is idle. */
void sf_seeder_search(sf_seeder *seeder, sf_view *const *views, size_t n, const sf_sweep_options *options);
/* Waits for the search to end. */
void sf_seeder_wait(sf_seeder *seeder);
/* What was found; 0: nothing yet. The caller's to sf_seeds_free. */
int sf_seeder_take(sf_seeder *seeder, sf_seeds *seeds);
void sf_seeds_free(sf_seeder *seeder, sf_seeds *seeds);

#endif
