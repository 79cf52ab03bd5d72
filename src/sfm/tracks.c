/* tracks.c - see tracks.h. Sets of keypoints are joined (union-find); the members of a set are a ring, so
 * that two sets are joined by exchanging two links. */
#include "tracks.h"

#include <stdlib.h>
#include <string.h>

typedef struct joiner {
    size_t *base;      /* [pictures + 1]: the number of each one's first keypoint */
    uint32_t *parent;  /* [keypoints]: towards the set's root */
    uint32_t *next;    /* [keypoints]: the ring */
    uint32_t *size;    /* [keypoints]: of roots: members */
    uint32_t *picture; /* [keypoints] */
    uint32_t *seen;    /* [pictures]: a stamp */
    uint32_t stamp;
} joiner;

static uint32_t root_of(joiner *j, uint32_t at) {
    while (j->parent[at] != at) at = j->parent[at] = j->parent[j->parent[at]];
    return at;
}

/* Whether two sets have no picture in common. */
static int are_apart(joiner *j, uint32_t a, uint32_t b) {
    uint32_t at = a;
    j->stamp++;
    do {
        j->seen[j->picture[at]] = j->stamp;
        at = j->next[at];
    } while (at != a);
    at = b;
    do {
        if (j->seen[j->picture[at]] == j->stamp) return 0;
        at = j->next[at];
    } while (at != b);
    return 1;
}

/* 0: they cannot be one point, for a picture would see it twice. */
static int join(joiner *j, uint32_t a, uint32_t b) {
    a = root_of(j, a), b = root_of(j, b);
    if (a == b) return 1;
    if (!are_apart(j, a, b)) return 0;
    if (j->size[a] < j->size[b]) {
        uint32_t other = a;
        a = b, b = other;
    }
    uint32_t link = j->next[a];
    j->parent[b] = a;
    j->size[a] += j->size[b];
    j->next[a] = j->next[b], j->next[b] = link;
    return 1;
}

static void join_pair(joiner *j, const sf_matched_pair *pair, sf_tracks *t) {
    uint32_t first = (uint32_t)j->base[pair->first], second = (uint32_t)j->base[pair->second];
    for (size_t k = 0; k < pair->count; k++)
        t->contradictions += !join(j, first + pair->matches[2 * k], second + pair->matches[2 * k + 1]);
    t->matches += pair->count;
}

static int compare_pairs(const void *a, const void *b) {
    const sf_matched_pair *x = *(const sf_matched_pair *const *)a, *y = *(const sf_matched_pair *const *)b;
    if (x->count != y->count) return x->count < y->count ? 1 : -1;
    if (x->first != y->first) return x->first < y->first ? -1 : 1;
    return x->second < y->second ? -1 : x->second > y->second;
}

static int make_joiner(sf_context *ctx, const size_t *counts, size_t pictures, joiner *j) {
    j->base = sf_calloc(ctx, pictures + 1, sizeof *j->base);
    if (!j->base) return 0;
    for (size_t i = 0; i < pictures; i++) j->base[i + 1] = j->base[i] + counts[i];
    size_t n = j->base[pictures];
    j->parent = sf_alloc(ctx, n + 1, sizeof *j->parent);
    j->next = sf_alloc(ctx, n + 1, sizeof *j->next);
    j->size = sf_alloc(ctx, n + 1, sizeof *j->size);
    j->picture = sf_alloc(ctx, n + 1, sizeof *j->picture);
    j->seen = sf_calloc(ctx, pictures + 1, sizeof *j->seen);
    if (!j->parent || !j->next || !j->size || !j->picture || !j->seen) return 0;
    for (size_t i = 0; i < pictures; i++)
        for (size_t k = j->base[i]; k < j->base[i + 1]; k++) {
            j->parent[k] = j->next[k] = (uint32_t)k;
            j->size[k] = 1;
            j->picture[k] = (uint32_t)i;
        }
    return 1;
}

static void free_joiner(sf_context *ctx, joiner *j) {
    void *const blocks[] = {j->base, j->parent, j->next, j->size, j->picture, j->seen};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ctx, blocks[i]);
}

/* Sets of two and more, in the order of their first keypoints: keypoints are numbered picture by picture, so
 * that each track comes sorted. number [keypoints]: of roots, the track. */
static void number_tracks(joiner *j, size_t n, uint32_t *number, sf_tracks *t, size_t *observations) {
    memset(number, 0xff, n * sizeof *number);
    for (size_t k = 0; k < n; k++) {
        uint32_t root = root_of(j, (uint32_t)k);
        if (j->size[root] < 2) continue;
        ++*observations;
        if (number[root] == UINT32_MAX) number[root] = (uint32_t)t->count++;
    }
}

static sf_status collect(sf_context *ctx, joiner *j, size_t pictures, sf_tracks *t) {
    size_t n = j->base[pictures], observations = 0;
    uint32_t *number = sf_alloc(ctx, n + 1, sizeof *number);
    if (!number) return SF_ERR_MEMORY;
    number_tracks(j, n, number, t, &observations);
    t->first = sf_calloc(ctx, t->count + 2, sizeof *t->first);
    t->observations = sf_alloc(ctx, observations + 1, sizeof *t->observations);
    int ready = t->first && t->observations;
    for (size_t k = 0; ready && k < n; k++)
        if (j->parent[k] == k && j->size[k] > 1) t->first[number[k] + 2] = j->size[k];
    for (size_t i = 2; ready && i < t->count + 2; i++) t->first[i] += t->first[i - 1];
    for (size_t k = 0; ready && k < n; k++) {
        uint32_t root = root_of(j, (uint32_t)k), picture = j->picture[k];
        if (j->size[root] > 1)
            t->observations[t->first[number[root] + 1]++] =
                (sf_track_observation){picture, (uint32_t)(k - j->base[picture])};
    }
    sf_free(ctx, number);
    return ready ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_tracks_make(sf_context *ctx, const sf_matched_pair *pairs, size_t pair_count,
                         const size_t *keypoint_counts, size_t pictures, sf_tracks *tracks) {
    joiner j = {0};
    const sf_matched_pair **order = sf_alloc(ctx, pair_count + 1, sizeof *order);
    *tracks = (sf_tracks){0};
    sf_status status = order && make_joiner(ctx, keypoint_counts, pictures, &j) ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < pair_count; i++) order[i] = &pairs[i];
    if (!status) qsort(order, pair_count, sizeof *order, compare_pairs);
    for (size_t i = 0; !status && i < pair_count; i++) join_pair(&j, order[i], tracks);
    if (!status) status = collect(ctx, &j, pictures, tracks);
    free_joiner(ctx, &j);
    sf_free(ctx, order);
    if (status) sf_tracks_free(ctx, tracks);
    return status;
}

void sf_tracks_free(sf_context *ctx, sf_tracks *tracks) {
    sf_free(ctx, tracks->first);
    sf_free(ctx, tracks->observations);
    *tracks = (sf_tracks){0};
}
