/* seeds.c - a thread that looks for points while the fit goes on. */
#include "seeds.h"

#include <pthread.h>

#include "../scene/nearest.h"

typedef enum seeder_state { IDLE, SEARCHING, FOUND, ENDING } seeder_state;

struct sf_seeder {
    sf_context *ctx, *own; /* the caller's; one thread, for the search */
    pthread_t thread;
    pthread_mutex_t lock; /* guards state; all else belongs to whose turn it is */
    pthread_cond_t changed;
    seeder_state state;
    sf_view *views[SF_SEED_VIEWS];
    size_t n;
    sf_sweep_options options;
    sf_seeds seeds;
};

static void search(sf_seeder *s) {
    sf_seeds *to = &s->seeds;
    *to = (sf_seeds){0};
    for (size_t i = 0; i < s->n; i++) to->ids[i] = s->views[i]->id;
    sf_status status =
        sf_sweep_points(s->own, (const sf_view *const *)s->views, s->n, &s->options, &to->cloud);
    if (!status && to->cloud.n) {
        to->radius = sf_alloc(s->own, to->cloud.n, sizeof *to->radius);
        status =
            to->radius ? sf_nearest_distances(s->own, to->cloud.xyz, to->cloud.n, to->radius) : SF_ERR_MEMORY;
    }
    if (status) to->cloud.n = 0; /* points are a help, not a need */
    for (size_t i = 0; i < s->n; i++) sf_view_release(s->views[i]);
    s->n = 0;
}

static void *run(void *seeder) {
    sf_seeder *s = seeder;
    pthread_mutex_lock(&s->lock);
    while (s->state != ENDING) {
        if (s->state != SEARCHING) {
            pthread_cond_wait(&s->changed, &s->lock);
            continue;
        }
        pthread_mutex_unlock(&s->lock);
        search(s);
        pthread_mutex_lock(&s->lock);
        if (s->state == SEARCHING) s->state = FOUND;
        pthread_cond_broadcast(&s->changed);
    }
    pthread_mutex_unlock(&s->lock);
    return NULL;
}

static void free_all(sf_seeder *s) {
    for (size_t i = 0; i < s->n; i++) sf_view_release(s->views[i]);
    sf_seeds_free(s, &s->seeds);
    sf_context_destroy(&s->own);
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->lock);
    sf_free(s->ctx, s);
}

sf_status sf_seeder_create(sf_context *ctx, sf_seeder **seeder) {
    *seeder = NULL;
    sf_seeder *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    sf_context_options own = {.allocator = &ctx->allocator, .threads = 1};
    sf_status status = sf_context_create(&s->own, &own);
    if (status) {
        sf_free(ctx, s);
        return status;
    }
    s->ctx = ctx;
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->changed, NULL);
    if (pthread_create(&s->thread, NULL, run, s)) {
        free_all(s);
        return sf_fail(ctx, SF_ERR_MEMORY, "no thread for the search of points can be created");
    }
    *seeder = s;
    return SF_OK;
}

static void set_state(sf_seeder *s, seeder_state state) {
    pthread_mutex_lock(&s->lock);
    s->state = state;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->lock);
}

static seeder_state state_of(sf_seeder *s) {
    pthread_mutex_lock(&s->lock);
    seeder_state state = s->state;
    pthread_mutex_unlock(&s->lock);
    return state;
}

void sf_seeder_destroy(sf_seeder **seeder) {
    sf_seeder *s = *seeder;
    if (!s) return;
    set_state(s, ENDING);
    pthread_join(s->thread, NULL);
    free_all(s);
    *seeder = NULL;
}

int sf_seeder_idle(sf_seeder *s) { return state_of(s) == IDLE; }

void sf_seeder_search(sf_seeder *s, sf_view *const *views, size_t n, const sf_sweep_options *options) {
    s->n = n < SF_SEED_VIEWS ? n : SF_SEED_VIEWS;
    for (size_t i = 0; i < s->n; i++) s->views[i] = sf_view_retain(views[i]);
    s->options = *options;
    set_state(s, SEARCHING);
}

void sf_seeder_wait(sf_seeder *s) {
    pthread_mutex_lock(&s->lock);
    while (s->state == SEARCHING) pthread_cond_wait(&s->changed, &s->lock);
    pthread_mutex_unlock(&s->lock);
}

int sf_seeder_take(sf_seeder *s, sf_seeds *seeds) {
    if (state_of(s) != FOUND) return 0;
    *seeds = s->seeds;
    s->seeds = (sf_seeds){0};
    set_state(s, IDLE);
    return 1;
}

void sf_seeds_free(sf_seeder *s, sf_seeds *seeds) {
    sf_cloud_destroy(s->own, &seeds->cloud);
    sf_free(s->own, seeds->radius);
    *seeds = (sf_seeds){0};
}
