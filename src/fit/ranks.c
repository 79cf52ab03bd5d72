/* ranks.c - see ranks.h. */
#include "ranks.h"

#include <string.h>

#include "../base/clock.h"
#include "../cluster/cluster.h"

static sf_cluster *cluster_of(const sf_fitter *f) { return sf_cluster_of(f->ctx); }

/* What a rank says of its scene. */
typedef struct scene_words {
    uint64_t views, fingerprint;
    char host[64];
} scene_words;

/* Every rank must read the same pictures and cameras, or they would fit different things. */
static sf_status compare_scenes(sf_fitter *f) {
    sf_cluster *c = cluster_of(f);
    sf_scene_info info;
    sf_cluster_info place;
    scene_words mine = {0}, *all = sf_alloc(f->ctx, (size_t)c->size, sizeof *all);
    if (!all) return SF_ERR_MEMORY;
    sf_scene_get_info(f->scene, &info);
    sf_cluster_get_info(f->ctx, &place);
    mine.views = info.train_views;
    (void)sf_scene_fingerprint(f->scene, &mine.fingerprint); /* unread pictures: 0, unlike the others' */
    memcpy(mine.host, place.host, sizeof mine.host);
    sf_cluster_gather_bytes(c, &mine, sizeof mine, all);
    sf_status status = SF_OK;
    for (int rank = 1; rank < c->size && !status; rank++)
        if (all[rank].views != all->views || all[rank].fingerprint != all->fingerprint)
            status =
                sf_fail(f->ctx, SF_ERR_ARGUMENT,
                        "scene: rank %d on %s has other pictures or cameras than rank 0 on %s: %llu and %llu "
                        "training views",
                        rank, all[rank].host, all->host, (unsigned long long)all[rank].views,
                        (unsigned long long)all->views);
    sf_free(f->ctx, all);
    return status;
}

sf_status sf_ranks_check(sf_fitter *f) { return sf_is_shared(f) ? compare_scenes(f) : SF_OK; }

int sf_is_first_rank(const sf_fitter *f) { return !sf_is_shared(f) || !cluster_of(f)->rank; }

double sf_fit_seconds(const sf_fitter *f) {
    return sf_is_shared(f) ? f->shared_seconds : sf_clock() - f->start;
}

int sf_ranks_begin_step(sf_fitter *f) {
    double now[3] = {0, atomic_load(&f->cancelled), (double)f->model->count};
    if (!sf_is_shared(f)) return now[1] > 0;
    if (!cluster_of(f)->rank) now[0] = sf_clock() - f->start;
    sf_cluster_sum(cluster_of(f), now, 3);
    f->shared_seconds = now[0];
    f->shared_count = (size_t)now[2];
    return now[1] > 0;
}

uint64_t sf_ranks_sent(const sf_fitter *f) { return sf_is_shared(f) ? cluster_of(f)->sent : 0; }

void sf_ranks_count_step(const sf_fitter *f, uint64_t before) {
    if (sf_is_shared(f)) cluster_of(f)->in_steps += cluster_of(f)->sent - before;
}

size_t sf_total(const sf_fitter *f, size_t count) {
    return sf_is_shared(f) ? sf_cluster_sum_count(cluster_of(f), count) : count;
}

int sf_is_part(const sf_fitter *f, const sf_model *from) {
    return sf_is_shared(f) && from && from->parts == (size_t)cluster_of(f)->size;
}

size_t sf_count_from(const sf_fitter *f, const sf_model *from) {
    return sf_is_part(f, from) ? sf_total(f, from->count) : from->count;
}

double sf_total_of(const sf_fitter *f, double value) {
    if (sf_is_shared(f)) sf_cluster_sum(cluster_of(f), &value, 1);
    return value;
}

double sf_of_first_rank(const sf_fitter *f, double value) {
    return sf_is_shared(f) ? sf_cluster_first(cluster_of(f), value) : value;
}

double sf_most_of_ranks(const sf_fitter *f, double value) {
    return sf_is_shared(f) ? sf_cluster_most(cluster_of(f), value) : value;
}

size_t sf_part_of_rank(const sf_fitter *f, size_t count) {
    if (!sf_is_shared(f)) return count;
    size_t n = (size_t)cluster_of(f)->size;
    return count / n + ((size_t)cluster_of(f)->rank < count % n);
}

uint64_t sf_place_of(const sf_fitter *f, size_t i) {
    return i + ((uint64_t)(sf_is_shared(f) ? cluster_of(f)->rank : 0) << 32);
}

size_t sf_share_of_largest(const sf_fitter *f, const double *values, size_t n, size_t wanted) {
    if (sf_is_shared(f)) return sf_cluster_largest(cluster_of(f), values, n, wanted);
    return n < wanted ? n : wanted;
}

/* A function of seed, step and rank, so that it need not be stored. */
sf_rng *sf_rng_of_rank(sf_fitter *f) {
    if (!sf_is_shared(f)) return &f->rng;
    sf_rng_seed(&f->rank_rng, (uint64_t)f->options.seed);
    sf_rng_seed(&f->rank_rng, f->rank_rng.s[0] + (uint64_t)f->step);
    sf_rng_seed(&f->rank_rng, f->rank_rng.s[0] + (uint64_t)cluster_of(f)->rank);
    return &f->rank_rng;
}
