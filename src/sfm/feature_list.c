/* feature_list.c - the features of a picture while they are found. */
#include "feature_list.h"

#include <stdlib.h>
#include <string.h>

void sf_feature_list_init(sf_feature_list *list, sf_context *ctx, size_t most) {
    *list = (sf_feature_list){.ctx = ctx, .most = most};
}

void sf_feature_list_free(sf_feature_list *list) {
    sf_free(list->ctx, list->points);
    sf_free(list->ctx, list->descriptors);
    sf_feature_list_init(list, list->ctx, list->most);
}

typedef struct ranked {
    sf_keypoint point;
    size_t index;
} ranked;

static int order(float a, float b) { return (a > b) - (a < b); }

/* A total order but for features that are the same in all. */
static int compare(const void *a_pointer, const void *b_pointer) {
    const sf_keypoint *a = &((const ranked *)a_pointer)->point, *b = &((const ranked *)b_pointer)->point;
    int by = order(b->response, a->response);
    if (!by) by = order(b->scale, a->scale);
    if (!by) by = order(a->y, b->y);
    if (!by) by = order(a->x, b->x);
    return by ? by : order(a->angle, b->angle);
}

/* Copies the best, each once, into arrays of at least most or count. Returns how many. */
static size_t copy_best(const sf_feature_list *list, const ranked *ranks, sf_keypoint *points,
                        uint8_t *descriptors) {
    size_t n = 0;
    for (size_t i = 0; i < list->count && n < list->most; i++) {
        if (i && !compare(&ranks[i - 1], &ranks[i])) continue;
        points[n] = ranks[i].point;
        memcpy(descriptors + n * SF_DESCRIPTOR, list->descriptors + ranks[i].index * SF_DESCRIPTOR,
               SF_DESCRIPTOR);
        n++;
    }
    return n;
}

/* Sorts what there is into arrays of their own, of `room` features. */
static sf_status sort(sf_feature_list *list, size_t room) {
    ranked *ranks = sf_alloc(list->ctx, list->count, sizeof *ranks);
    sf_keypoint *points = sf_alloc(list->ctx, room, sizeof *points);
    uint8_t *descriptors = sf_alloc(list->ctx, room, SF_DESCRIPTOR);
    if (ranks && points && descriptors) {
        for (size_t i = 0; i < list->count; i++) ranks[i] = (ranked){list->points[i], i};
        qsort(ranks, list->count, sizeof *ranks, compare);
        list->count = copy_best(list, ranks, points, descriptors);
        sf_free(list->ctx, list->points);
        sf_free(list->ctx, list->descriptors);
        list->points = points, list->descriptors = descriptors;
        list->capacity = room;
        sf_free(list->ctx, ranks);
        return SF_OK;
    }
    sf_free(list->ctx, ranks);
    sf_free(list->ctx, points);
    sf_free(list->ctx, descriptors);
    return SF_ERR_MEMORY;
}

static sf_status make_room(sf_feature_list *list) {
    enum { FIRST = 1024 };
    if (list->count >= 2 * list->most) return sort(list, list->capacity);
    size_t need = list->count ? 2 * list->count : FIRST, points = list->capacity, bytes = points;
    if (list->count && need > 2 * list->most) need = 2 * list->most;
    sf_status status = sf_grow(list->ctx, &list->points, &points, list->count, need, sizeof *list->points);
    if (!status) status = sf_grow(list->ctx, &list->descriptors, &bytes, list->count, need, SF_DESCRIPTOR);
    if (!status) list->capacity = need;
    return status;
}

uint8_t *sf_feature_list_add(sf_feature_list *list, const sf_keypoint *point) {
    if (list->count == list->capacity && make_room(list)) return NULL;
    list->points[list->count] = *point;
    return list->descriptors + list->count++ * SF_DESCRIPTOR;
}

sf_status sf_feature_list_take(sf_feature_list *list, sf_features *features) {
    *features = (sf_features){0};
    if (!list->count) return SF_OK;
    sf_status status = sort(list, list->count < list->most ? list->count : list->most);
    if (status) return status;
    *features = (sf_features){list->count, list->points, list->descriptors};
    sf_feature_list_init(list, list->ctx, list->most);
    return SF_OK;
}
