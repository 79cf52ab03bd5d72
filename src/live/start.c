/* start.c - see start.h. */
#include "start.h"

#include <math.h>
#include <string.h>

#include "../base/statistics.h"

enum {
    FEATURES = 800,      /* of a frame at most */
    SIDE = 800,          /* px: of larger pictures, features are found in a reduced one */
    FEATURES_LEAST = 40, /* of a frame that shows something */
    ALIKE = 20,          /* matches of two frames that show the same place, at least */
    STRANGERS = 5,       /* frames of another place, until the collection begins anew */
    ATTEMPT_LEAST = 8,   /* frames, for a map to be tried */
    NEWS_LEAST = 2       /* new frames from one attempt to the next; or a sixth of the frames */
};

/* Widths of the picture: what a feature moves at least from one frame that is kept to the next. */
#define MOVED 0.015
/* Focal lengths of two attempts that are the same: the logarithm of their ratio. */
#define SAME_FOCAL 0.03

/* 1. Features */

static void free_frame(const sf_start *s, sf_start_frame *f) {
    sf_free(s->ctx, f->rgb);
    sf_features_free(s->ctx, &f->features);
    *f = (sf_start_frame){0};
}

static int factor_of(const sf_camera *c) {
    int side = c->width > c->height ? c->width : c->height;
    return (side + SIDE - 1) / SIDE;
}

/* Grey bytes, reduced by a whole factor. */
static void make_grey(const sf_picture *p, int factor, int width, int height, uint8_t *grey) {
    size_t stride = (size_t)p->camera.width, f = (size_t)factor;
    for (size_t y = 0; y < (size_t)height; y++)
        for (size_t x = 0; x < (size_t)width; x++) {
            float sum = 0;
            for (size_t v = 0; v < f; v++)
                for (size_t u = 0; u < f; u++) sum += sf_picture_grey(p, (y * f + v) * stride + x * f + u);
            grey[y * (size_t)width + x] =
                (uint8_t)(255 * fminf(fmaxf(sum / (float)(factor * factor), 0), 1) + 0.5f);
        }
}

static sf_status find_features(const sf_start *s, const sf_picture *p, sf_features *features) {
    sf_features_options options = sf_features_options_default();
    int factor = factor_of(&p->camera);
    sf_photo photo = {.width = p->camera.width / factor, .height = p->camera.height / factor};
    photo.stride = (size_t)photo.width;
    uint8_t *grey = sf_alloc(s->ctx, photo.stride * (size_t)photo.height, 1);
    *features = (sf_features){0};
    if (!grey) return SF_ERR_MEMORY;
    make_grey(p, factor, photo.width, photo.height, grey);
    photo.pixels = grey;
    options.most = FEATURES;
    sf_status status = sf_features_find(s->ctx, &photo, &options, features);
    sf_free(s->ctx, grey);
    for (size_t i = 0; i < features->count; i++)
        features->points[i].x *= (float)factor, features->points[i].y *= (float)factor;
    return status;
}

/* 2. The collection */

/* The median way of the matched features, in widths of the picture. */
static sf_status median_way(const sf_start *s, const sf_features *a, const sf_features *b,
                            const sf_matches *m, double width, double *way) {
    double *ways = sf_alloc(s->ctx, m->count + 1, sizeof *ways);
    if (!ways) return SF_ERR_MEMORY;
    for (size_t i = 0; i < m->count; i++) {
        const sf_keypoint *p = &a->points[m->items[i].a], *q = &b->points[m->items[i].b];
        ways[i] = hypot((double)(p->x - q->x), (double)(p->y - q->y)) / width;
    }
    *way = sf_median(ways, m->count);
    sf_free(s->ctx, ways);
    return SF_OK;
}

static void drop_frame(sf_start *s, size_t gone) {
    if (gone + 1 < s->count && gone) s->frames[gone + 1].moved += s->frames[gone].moved;
    free_frame(s, &s->frames[gone]);
    for (size_t k = 0; k < gone; k++) sf_matches_free(s->ctx, &s->matches[k][gone]);
    for (size_t k = gone + 1; k < s->count; k++) sf_matches_free(s->ctx, &s->matches[gone][k]);
    s->count--;
    memmove(s->frames + gone, s->frames + gone + 1, (s->count - gone) * sizeof *s->frames);
    for (size_t a = 0; a < s->count; a++)
        for (size_t b = a + 1; b < s->count; b++)
            s->matches[a][b] = s->matches[a + (a >= gone)][b + (b >= gone)];
    for (size_t a = 0; a < s->count; a++) s->matches[a][s->count] = (sf_matches){0};
    memset(&s->matches[s->count], 0, sizeof s->matches[s->count]);
    memset(&s->frames[s->count], 0, sizeof s->frames[s->count]);
}

/* Makes room: what no longer shares the newest one's place goes first, else the frame that stands closest to
 * its neighbours. */
static void thin_out(sf_start *s) {
    size_t gone = 1;
    double least = INFINITY;
    for (size_t i = 1; i + 1 < s->count; i++) {
        double both = s->frames[i].moved + s->frames[i + 1].moved;
        if (both < least) least = both, gone = i;
    }
    if (s->matches[0][s->count - 1].count < ALIKE) gone = 0;
    drop_frame(s, gone);
}

/* The frame joins those that are kept: its features are given away. */
static sf_status keep_frame(sf_start *s, const sf_picture *p, uint64_t number, sf_features *features,
                            double moved) {
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    sf_match_options options = sf_match_options_default();
    if (s->count == SF_FIRST_MAP_MOST) thin_out(s);
    uint8_t *rgb = sf_alloc(s->ctx, pixels, 3);
    if (!rgb) return SF_ERR_MEMORY;
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = (uint8_t)(255 * fminf(fmaxf(p->rgb[c][i], 0), 1) + 0.5f);
    for (size_t k = 0; k < s->count; k++) {
        sf_status status =
            sf_match_pair(s->ctx, &s->frames[k].features, features, &options, &s->matches[k][s->count]);
        if (!status) continue;
        for (size_t i = 0; i < k; i++) sf_matches_free(s->ctx, &s->matches[i][s->count]);
        sf_free(s->ctx, rgb);
        return status;
    }
    s->frames[s->count++] =
        (sf_start_frame){.picture = *p, .rgb = rgb, .features = *features, .moved = moved, .number = number};
    *features = (sf_features){0};
    s->news++;
    return SF_OK;
}

/* Whether the frame shows what the newest one that is kept shows, from another place; and how far it is. */
static sf_status is_wanted(sf_start *s, const sf_picture *p, const sf_features *features, double *moved,
                           int *wanted) {
    sf_match_options options = sf_match_options_default();
    sf_matches matches;
    *moved = 0, *wanted = 0;
    if (features->count < FEATURES_LEAST) {
        if (!s->count) s->map.verdict = SF_FIRST_MAP_FEW;
        return SF_OK;
    }
    if (!s->count) {
        s->map.verdict = SF_FIRST_MAP_STILL;
        *wanted = 1;
        return SF_OK;
    }
    const sf_features *last = &s->frames[s->count - 1].features;
    sf_status status = sf_match_pair(s->ctx, last, features, &options, &matches);
    if (status) return status;
    s->strangers = matches.count < ALIKE ? s->strangers + 1 : 0;
    if (matches.count >= ALIKE) status = median_way(s, last, features, &matches, p->camera.width, moved);
    *wanted = *moved > MOVED;
    if (s->strangers >= STRANGERS) {
        sf_start_clear(s);
        *wanted = 1;
    }
    sf_matches_free(s->ctx, &matches);
    return status;
}

/* 3. The map */

static sf_status attempt(sf_start *s, const sf_lens *lens) {
    sf_features features[SF_FIRST_MAP_MOST];
    const sf_camera *c = &s->frames[0].picture.camera;
    sf_first_map_input input = {.width = c->width,
                                .height = c->height,
                                .lens = lens ? *lens
                                             : (sf_lens){.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy},
                                .is_lens_known = lens != NULL,
                                .count = s->count,
                                .features = features,
                                .matches = &s->matches};
    for (size_t i = 0; i < s->count; i++) features[i] = s->frames[i].features;
    s->news = 0;
    sf_status status = sf_first_map_find(s->ctx, &input, &s->map);
    if (status || lens) return status;
    /* What few frames say of the lens is believed when some more say the same. */
    double focal = s->map.lens.fx;
    if (s->map.verdict == SF_FIRST_MAP_FOUND && !(s->focal > 0 && fabs(log(focal / s->focal)) < SAME_FOCAL))
        s->map.verdict = SF_FIRST_MAP_DOUBTFUL;
    s->focal = focal;
    return SF_OK;
}

sf_status sf_start_take(sf_start *s, const sf_picture *p, uint64_t number, const sf_lens *lens, int *found) {
    sf_features features;
    double moved;
    int wanted;
    *found = 0;
    sf_status status = find_features(s, p, &features);
    if (!status) status = is_wanted(s, p, &features, &moved, &wanted);
    if (!status && wanted) status = keep_frame(s, p, number, &features, moved);
    sf_features_free(s->ctx, &features);
    if (status || !wanted || s->count < ATTEMPT_LEAST || s->news < NEWS_LEAST || s->news < s->count / 6)
        return status;
    status = attempt(s, lens);
    *found = !status && s->map.verdict == SF_FIRST_MAP_FOUND;
    if (*found) s->next = 0;
    return status;
}

int sf_start_is_ready(const sf_start *s) { return s->map.verdict == SF_FIRST_MAP_FOUND; }

static sf_status make_planes(sf_start *s, sf_start_frame *f) {
    sf_picture *p = &f->picture;
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    sf_status status = sf_grow(s->ctx, &s->planes, &s->capacity, 0, 3 * pixels, sizeof *s->planes);
    if (status) return status;
    for (size_t c = 0; c < 3; c++) {
        p->rgb[c] = s->planes + c * pixels;
        for (size_t i = 0; i < pixels; i++) p->rgb[c][i] = (float)f->rgb[3 * i + c] / 255;
    }
    p->weight = NULL;
    return SF_OK;
}

sf_status sf_start_next(sf_start *s, const sf_picture **picture, uint64_t *number, sf_rigid *pose) {
    *picture = NULL;
    while (s->next < s->count && !s->map.is_placed[s->next]) s->next++;
    if (s->next >= s->count) {
        sf_start_clear(s);
        return SF_OK;
    }
    sf_start_frame *f = &s->frames[s->next];
    sf_status status = make_planes(s, f);
    if (status) return status;
    *picture = &f->picture, *number = f->number, *pose = s->map.poses[s->next++];
    return SF_OK;
}

void sf_start_clear(sf_start *s) {
    for (size_t a = 0; a < s->count; a++) {
        free_frame(s, &s->frames[a]);
        for (size_t b = a + 1; b < s->count; b++) sf_matches_free(s->ctx, &s->matches[a][b]);
    }
    s->count = s->news = s->next = 0;
    s->strangers = 0;
    s->focal = 0;
    s->map = (sf_first_map){0};
}

void sf_start_free(sf_start *s) {
    sf_start_clear(s);
    sf_free(s->ctx, s->planes);
    s->planes = NULL, s->capacity = 0;
}
