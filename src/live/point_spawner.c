/* point_spawner.c - a thread that matches keyframes to find points while the fit goes on. */
#include "point_spawner.h"

#include <pthread.h>

#include "../scene/nearest.h"

typedef enum spawner_state { IDLE, SEARCHING, FOUND, ENDING } spawner_state;

struct sf_spawner {
    sf_context *ctx, *own; /* the caller's; one thread, for the search */
    pthread_t thread;
    pthread_mutex_t lock; /* guards state; all else belongs to whose turn it is */
    pthread_cond_t changed;
    spawner_state state;
    sf_view *views[SF_SPAWN_VIEWS];
    size_t n;
    sf_sweep_options options;
    sf_spawned_points points;
};

static void search(sf_spawner *s) {
    sf_spawned_points *to = &s->points;
    *to = (sf_spawned_points){0};
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

static void *run(void *spawner) {
    sf_spawner *s = spawner;
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

static void free_all(sf_spawner *s) {
    for (size_t i = 0; i < s->n; i++) sf_view_release(s->views[i]);
    sf_spawned_points_free(s, &s->points);
    sf_context_destroy(&s->own);
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->lock);
    sf_free(s->ctx, s);
}

sf_status sf_spawner_create(sf_context *ctx, sf_spawner **spawner) {
    *spawner = NULL;
    sf_spawner *s = sf_calloc(ctx, 1, sizeof *s);
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
    *spawner = s;
    return SF_OK;
}

static void set_state(sf_spawner *s, spawner_state state) {
    pthread_mutex_lock(&s->lock);
    s->state = state;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->lock);
}

static spawner_state state_of(sf_spawner *s) {
    pthread_mutex_lock(&s->lock);
    spawner_state state = s->state;
    pthread_mutex_unlock(&s->lock);
    return state;
}

void sf_spawner_destroy(sf_spawner **spawner) {
    sf_spawner *s = *spawner;
    if (!s) return;
    set_state(s, ENDING);
    pthread_join(s->thread, NULL);
    free_all(s);
    *spawner = NULL;
}

int sf_spawner_idle(sf_spawner *s) { return state_of(s) == IDLE; }

void sf_spawner_search(sf_spawner *s, sf_view *const *views, size_t n, const sf_sweep_options *options) {
    s->n = n < SF_SPAWN_VIEWS ? n : SF_SPAWN_VIEWS;
    for (size_t i = 0; i < s->n; i++) s->views[i] = sf_view_retain(views[i]);
    s->options = *options;
    set_state(s, SEARCHING);
}

void sf_spawner_wait(sf_spawner *s) {
    pthread_mutex_lock(&s->lock);
    while (s->state == SEARCHING) pthread_cond_wait(&s->changed, &s->lock);
    pthread_mutex_unlock(&s->lock);
}

int sf_spawner_take(sf_spawner *s, sf_spawned_points *points) {
    if (state_of(s) != FOUND) return 0;
    *points = s->points;
    s->points = (sf_spawned_points){0};
    set_state(s, IDLE);
    return 1;
}

void sf_spawned_points_free(sf_spawner *s, sf_spawned_points *points) {
    sf_cloud_destroy(s->own, &points->cloud);
    sf_free(s->own, points->radius);
    *points = (sf_spawned_points){0};
}
