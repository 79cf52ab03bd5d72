/* track.c - the pose of a picture against the model: the model is drawn from a guess, and the drawn pixels,
 * as points at their depths, are moved to where the picture looks like them (README, P.7). */
#include "track.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "../render/workspace.h"
#include "patch.h"

enum {
    LEVELS = 3,        /* halvings of the picture that is compared: near guesses need the first two */
    FINEST_SIDE = 200, /* px, of that picture's longest side at most */
    LEAST_SIDE = 8,
    ROUNDS = 12,      /* of Gauss and Newton, for one drawing of the model, */
    ROUNDS_CLOSE = 3, /* and of a guess that is close */
    DRAWINGS = 3,     /* of the model a level, at most */
    UNKNOWNS = 8,     /* twist, gain, bias */
    BINS = 64,        /* of absolute differences, 1/BIN_SCALE wide */
    BIN_SCALE = 256
};

#define SOLID     0.5f  /* transmittance up to which a drawn pixel has a depth */
#define EDGE      0.1f  /* depths of neighbours that differ by more are no surface */
#define NARROWEST 0.008 /* width of the weights, at least */
#define WIDTHS    2.4   /* of them, in medians of the differences */
#define FIRST     0.1   /* of them, before any is known */
#define CORRELATED                                                                                           \
    200.0 /* pixels that tell as much as one: what is wrong of the model is wrong in all of them */
#define STILL     2e-5 /* a step that turns by less, or moves by less of the depth, ends the rounds */
#define REDRAW    1.0  /* px that points have moved by on average, for the model to be drawn again */
#define GAIN_HOLD 1e-4 /* what keeps the gain near 1 and the bias near 0, in pixels of all */

/* A drawn pixel as a point. */
typedef struct point {
    float value, at[3], d_twist[SF_TWIST]; /* grey; camera's frame; of the grey value, by the twist */
} point;

/* What a row of points adds up to. */
typedef struct row_sums {
    double H[UNKNOWNS * (UNKNOWNS + 1) / 2], g[UNKNOWNS], cost;
    double points, count, a, b, aa, bb, ab, moved; /* all but the first weighted, for the correlation; px */
    double drawn_detail, detail;                   /* squares of differences of neighbours */
    uint32_t bins[BINS];
} row_sums;

typedef struct level {
    sf_camera camera; /* of the picture at this level; its pose is the drawing's */
    float *grey;      /* [height][width] */
    size_t capacity;
} level;

struct sf_tracker {
    sf_context *ctx;
    sf_workspace ws;
    level levels[LEVELS]; /* from the finest */
    int level_count;
    point *points;   /* [height][width], each row's first so many */
    uint32_t *found; /* [height] of them */
    row_sums *rows;  /* [height] */
    size_t point_capacity, found_capacity, row_capacity;

    /* of the rounds in progress */
    const level *at;
    sf_rigid moved; /* from the drawing's camera to the picture's */
    double gain, bias, width;
};

sf_status sf_tracker_create(sf_context *ctx, sf_tracker **tracker) {
    *tracker = sf_calloc(ctx, 1, sizeof **tracker);
    if (!*tracker) return SF_ERR_MEMORY;
    (*tracker)->ctx = ctx;
    sf_workspace_init(&(*tracker)->ws, ctx);
    return SF_OK;
}

void sf_tracker_destroy(sf_tracker **tracker) {
    sf_tracker *t = *tracker;
    if (!t) return;
    for (int i = 0; i < LEVELS; i++) sf_free(t->ctx, t->levels[i].grey);
    sf_free(t->ctx, t->points);
    sf_free(t->ctx, t->found);
    sf_free(t->ctx, t->rows);
    sf_workspace_free(&t->ws);
    sf_free(t->ctx, t);
    *tracker = NULL;
}

/* 1. The picture, smaller and smaller */

static void shrink_picture(float *const rgb[3], size_t stride, int factor, const level *to) {
    size_t n = (size_t)factor, width = (size_t)to->camera.width, height = (size_t)to->camera.height;
    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++) {
            float sum[3] = {0};
            for (int c = 0; c < 3; c++)
                for (size_t i = 0; i < n; i++)
                    for (size_t j = 0; j < n; j++) sum[c] += rgb[c][(y * n + i) * stride + x * n + j];
            to->grey[y * width + x] = sf_grey(sum[0], sum[1], sum[2]) / (float)(n * n);
        }
}

static int longest(const sf_camera *camera) {
    return camera->width > camera->height ? camera->width : camera->height;
}

static int shortest(const sf_camera *camera) {
    return camera->width < camera->height ? camera->width : camera->height;
}

static size_t pixels_of(const sf_camera *camera) { return (size_t)camera->width * (size_t)camera->height; }

sf_status sf_tracker_take(sf_tracker *t, const sf_camera *camera, float *const rgb[3], size_t stride) {
    int factor = (longest(camera) + FINEST_SIDE - 1) / FINEST_SIDE;
    t->level_count = 0;
    for (int i = 0; i < LEVELS; i++, factor *= 2) {
        level *l = &t->levels[i];
        if (i && shortest(camera) / factor < LEAST_SIDE) break;
        l->camera = sf_camera_downscaled(camera, factor);
        sf_status status = sf_grow(t->ctx, &l->grey, &l->capacity, 0, pixels_of(&l->camera), sizeof *l->grey);
        if (status) return status;
        shrink_picture(rgb, stride, factor, l);
        t->level_count++;
    }
    const sf_camera *finest = &t->levels[0].camera;
    size_t rows = (size_t)finest->height;
    sf_status status =
        sf_grow(t->ctx, &t->points, &t->point_capacity, 0, pixels_of(finest), sizeof *t->points);
    if (!status) status = sf_grow(t->ctx, &t->found, &t->found_capacity, 0, rows, sizeof *t->found);
    if (!status) status = sf_grow(t->ctx, &t->rows, &t->row_capacity, 0, rows, sizeof *t->rows);
    return status;
}

/* 2. The drawing as points */

static float grey_of(const sf_workspace *ws, size_t at) {
    return sf_grey(ws->rgb[0][at], ws->rgb[1][at], ws->rgb[2][at]);
}

/* In the model's unit; 0: nothing is there. */
static float depth_of(const sf_workspace *ws, size_t at) {
    float T = ws->transmittance[at];
    return T < SOLID ? ws->depth[at] / (1 - T) : 0;
}

static int is_surface(const sf_workspace *ws, size_t at, float z) {
    const size_t around[4] = {at - 1, at + 1, at - ws->stride, at + ws->stride};
    for (int i = 0; i < 4; i++)
        if (!(fabsf(depth_of(ws, around[i]) - z) <= EDGE * z)) return 0;
    return z > 0;
}

static point point_at(const sf_workspace *ws, const sf_camera *c, size_t x, size_t y, float z) {
    size_t at = y * ws->stride + x;
    double u = ((double)x + 0.5 - c->cx) / c->fx, v = ((double)y + 0.5 - c->cy) / c->fy, d = (double)z;
    double dx = (double)(grey_of(ws, at + 1) - grey_of(ws, at - 1)) / 2 * c->fx;
    double dy = (double)(grey_of(ws, at + ws->stride) - grey_of(ws, at - ws->stride)) / 2 * c->fy;
    /* by the point: (dx/z, dy/z, -(u dx + v dy)/z); by phi: p x that */
    double along = u * dx + v * dy;
    point p = {.value = grey_of(ws, at), .at = {(float)(u * d), (float)(v * d), z}};
    const double twist[SF_TWIST] = {dx / d,          dy / d,         -along / d,
                                    -v * along - dy, dx + u * along, u * dy - v * dx};
    for (int k = 0; k < SF_TWIST; k++) p.d_twist[k] = (float)twist[k];
    return p;
}

static void points_task(void *tracker, size_t y, int thread) {
    (void)thread;
    sf_tracker *t = tracker;
    const sf_camera *c = &t->at->camera;
    size_t width = (size_t)c->width;
    point *to = t->points + y * width;
    float unit = ldexpf(1, t->ws.unit);
    t->found[y] = 0;
    if (y == 0 || y + 1 == (size_t)c->height) return;
    for (size_t x = 1; x + 1 < width; x++) {
        float z = depth_of(&t->ws, y * t->ws.stride + x);
        if (is_surface(&t->ws, y * t->ws.stride + x, z))
            to[t->found[y]++] = point_at(&t->ws, c, x, y, unit * z);
    }
}

static sf_status draw(sf_tracker *t, level *l, const sf_model *model, const sf_render_options *options,
                      const sf_rigid *pose) {
    memcpy(l->camera.R_cw, pose->R, sizeof pose->R);
    memcpy(l->camera.t_cw, pose->t, sizeof pose->t);
    sf_status status = sf_forward(&t->ws, model, &l->camera, options, 1);
    if (status) return status;
    t->at = l;
    t->moved = (sf_rigid){.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_pool_run(t->ctx->pool, (size_t)l->camera.height, points_task, t);
    return SF_OK;
}

/* 3. Gauss and Newton */

/* The picture between its pixels, and the square of its slope there, a px; 0: outside of it. */
static int look_up(const level *l, double u, double v, double *value, double *slope) {
    int width = l->camera.width, height = l->camera.height;
    if (!(u >= 0.5 && v >= 0.5 && u < width - 0.5 && v < height - 0.5)) return 0;
    int x = (int)(u - 0.5), y = (int)(v - 0.5);
    if (x + 1 >= width || y + 1 >= height) return 0;
    const float *p = l->grey + (size_t)y * (size_t)width + (size_t)x;
    double a = u - 0.5 - x, b = v - 0.5 - y;
    double top = (double)p[0] + a * (double)(p[1] - p[0]);
    double bottom = (double)p[width] + a * (double)(p[width + 1] - p[width]);
    double across = (1 - b) * (double)(p[1] - p[0]) + b * (double)(p[width + 1] - p[width]);
    *value = top + b * (bottom - top);
    *slope = across * across + (bottom - top) * (bottom - top);
    return 1;
}

static void add_point(const sf_tracker *t, const point *p, row_sums *s) {
    const sf_camera *c = &t->at->camera;
    double at[3] = {(double)p->at[0], (double)p->at[1], (double)p->at[2]}, q[3], value, slope;
    sf_mat3_vec(t->moved.R, at, q);
    for (int k = 0; k < 3; k++) q[k] += t->moved.t[k];
    if (!(q[2] > 0.1 * at[2])) return;
    double u = c->fx * q[0] / q[2] + c->cx, v = c->fy * q[1] / q[2] + c->cy;
    if (!look_up(t->at, u, v, &value, &slope)) return;
    double drawn = (double)p->value, r = value - (t->gain * drawn + t->bias), part = r / t->width;
    double w = 1 / (1 + part * part), J[UNKNOWNS];
    for (int k = 0; k < SF_TWIST; k++) J[k] = t->gain * (double)p->d_twist[k];
    J[6] = -drawn, J[7] = -1;
    for (int i = 0, at_H = 0; i < UNKNOWNS; i++) {
        s->g[i] += w * J[i] * r;
        for (int j = 0; j <= i; j++) s->H[at_H++] += w * J[i] * J[j];
    }
    s->cost += w * r * r; /* as Geman and McClure have it */
    s->points++;
    s->count += w;
    s->a += w * drawn, s->b += w * value;
    s->aa += w * drawn * drawn, s->bb += w * value * value, s->ab += w * drawn * value;
    s->drawn_detail += (pow(J[0] * at[2] / c->fx, 2) + pow(J[1] * at[2] / c->fy, 2));
    s->detail += slope;
    s->moved += w * (fabs(u - (c->fx * at[0] / at[2] + c->cx)) + fabs(v - (c->fy * at[1] / at[2] + c->cy)));
    int bin = (int)(fabs(r) * BIN_SCALE);
    s->bins[bin < BINS ? bin : BINS - 1]++;
}

static void sums_task(void *tracker, size_t y, int thread) {
    (void)thread;
    sf_tracker *t = tracker;
    row_sums *s = &t->rows[y];
    memset(s, 0, sizeof *s);
    const point *points = t->points + y * (size_t)t->at->camera.width;
    for (uint32_t i = 0; i < t->found[y]; i++) add_point(t, points + i, s);
}

/* In the order of the rows, for any number of threads. */
static void add_up(sf_tracker *t, row_sums *all) {
    size_t height = (size_t)t->at->camera.height;
    sf_pool_run(t->ctx->pool, height, sums_task, t);
    memset(all, 0, sizeof *all);
    for (size_t y = 0; y < height; y++) {
        const row_sums *s = &t->rows[y];
        for (size_t k = 0; k < sizeof all->H / sizeof *all->H; k++) all->H[k] += s->H[k];
        for (int k = 0; k < UNKNOWNS; k++) all->g[k] += s->g[k];
        for (int k = 0; k < BINS; k++) all->bins[k] += s->bins[k];
        all->cost += s->cost, all->count += s->count;
        all->points += s->points;
        all->a += s->a, all->b += s->b, all->aa += s->aa, all->bb += s->bb, all->ab += s->ab;
        all->moved += s->moved;
        all->drawn_detail += s->drawn_detail, all->detail += s->detail;
    }
}

static double median_of(const row_sums *s) {
    uint64_t all = 0, below = 0;
    for (int k = 0; k < BINS; k++) all += s->bins[k];
    int k = 0;
    while (k < BINS - 1 && 2 * (below + s->bins[k]) < all) below += s->bins[k++];
    double part = s->bins[k] ? ((double)all / 2 - (double)below) / (double)s->bins[k] : 0.5;
    return (k + part) / BIN_SCALE;
}

/* Variance of what a pixel tells, were all independent. */
static double noise_of(const row_sums *s) {
    return CORRELATED * fmax(s->cost / fmax(s->count, 1), NARROWEST * NARROWEST);
}

/* The normal equations: of the pixels, of the prior, and of what holds gain and bias. */
static void equations(const sf_tracker *t, const row_sums *s, const sf_rigid *pose,
                      const sf_track_prior *prior, double A[UNKNOWNS * UNKNOWNS], double g[UNKNOWNS]) {
    double noise = noise_of(s), hold = GAIN_HOLD * s->count / noise;
    for (int i = 0, at = 0; i < UNKNOWNS; i++) {
        g[i] = s->g[i] / noise;
        for (int j = 0; j <= i; j++, at++) A[i * UNKNOWNS + j] = A[j * UNKNOWNS + i] = s->H[at] / noise;
    }
    for (int i = SF_TWIST; i < UNKNOWNS; i++) {
        A[i * UNKNOWNS + i] += hold;
        g[i] += hold * (i == SF_TWIST ? t->gain - 1 : t->bias);
    }
    if (!prior) return;
    double off[SF_TWIST];
    sf_rigid_twist(&prior->pose, pose, off);
    for (int i = 0; i < SF_TWIST; i++)
        for (int j = 0; j < SF_TWIST; j++) {
            A[i * UNKNOWNS + j] += prior->information[i * SF_TWIST + j];
            g[i] += prior->information[i * SF_TWIST + j] * off[j];
        }
}

/* A step's size: radians, and parts of the depth. */
static double size_of(const double *step, double depth) {
    double turn = sqrt(sf_dot3(step + 3, step + 3)), move = sqrt(sf_dot3(step, step));
    return fmax(turn, depth > 0 ? move / depth : 0);
}

static double mean_depth(const sf_tracker *t) {
    double sum = 0, count = 0;
    for (size_t y = 0; y < (size_t)t->at->camera.height; y++)
        for (uint32_t i = 0; i < t->found[y]; i++, count++)
            sum += (double)t->points[y * (size_t)t->at->camera.width + i].at[2];
    return count > 0 ? sum / count : 0;
}

/* Moves the drawn points to where the picture looks like them. `drawn`: where the drawing was made from; *s:
 * the sums at the end. */
static void align(sf_tracker *t, const sf_rigid *drawn, const sf_track_prior *prior, int rounds, row_sums *s,
                  sf_rigid *pose) {
    double depth = mean_depth(t), least = INFINITY, before[2] = {t->gain, t->bias};
    sf_rigid best = t->moved;
    add_up(t, s);
    for (int round = 0; round < rounds; round++) {
        double A[UNKNOWNS * UNKNOWNS], g[UNKNOWNS], cost = s->points > 0 ? s->cost / s->points : INFINITY;
        if (!(cost < least)) { /* that step did harm */
            t->moved = best, t->gain = before[0], t->bias = before[1];
            add_up(t, s);
            break;
        }
        best = t->moved, before[0] = t->gain, before[1] = t->bias;
        sf_rigid_compose(&t->moved, drawn, pose);
        equations(t, s, pose, prior, A, g);
        if (!(s->count > UNKNOWNS) || !sf_cholesky(UNKNOWNS, A)) break;
        sf_cholesky_solve(UNKNOWNS, A, g);
        for (int k = 0; k < UNKNOWNS; k++) g[k] = -g[k];
        sf_rigid_move(&t->moved, g);
        t->gain = fmin(fmax(t->gain + g[6], 0.1), 10), t->bias = fmin(fmax(t->bias + g[7], -1), 1);
        double width = fmax(WIDTHS * median_of(s), NARROWEST);
        add_up(t, s);
        least = cost;
        if (size_of(g, depth) < STILL) break;
        if (fabs(width / t->width - 1) > 0.1) { /* costs of another width do not compare */
            t->width = width, least = INFINITY;
            add_up(t, s);
        }
    }
    sf_rigid_compose(&t->moved, drawn, pose);
}

static void conclude(const sf_tracker *t, const row_sums *s, const sf_track_prior *prior, sf_track *track) {
    double A[UNKNOWNS * UNKNOWNS], g[UNKNOWNS], inverse[UNKNOWNS * UNKNOWNS], n = fmax(s->count, 1e-9);
    double aa = s->aa / n - pow(s->a / n, 2), bb = s->bb / n - pow(s->b / n, 2),
           ab = s->ab / n - s->a / n * s->b / n;
    size_t found = 0;
    for (size_t y = 0; y < (size_t)t->at->camera.height; y++) found += t->found[y];
    track->gain = t->gain, track->bias = t->bias;
    track->depth = mean_depth(t);
    track->rms = sqrt(s->cost / n);
    track->seen = (double)found / (double)pixels_of(&t->at->camera);
    track->detail = s->detail / fmax(s->drawn_detail, 1e-12);
    track->agreement = aa > 1e-8 && bb > 1e-8 ? ab / sqrt(aa * bb) : 0;
    equations(t, s, &track->pose, prior, A, g);
    memset(track->covariance, 0, sizeof track->covariance);
    if (!sf_cholesky(UNKNOWNS, A)) {
        for (int i = 0; i < SF_TWIST; i++) track->covariance[i * SF_TWIST + i] = INFINITY;
        return;
    }
    sf_cholesky_invert(UNKNOWNS, A, inverse);
    for (int i = 0; i < SF_TWIST; i++)
        for (int j = 0; j < SF_TWIST; j++) track->covariance[i * SF_TWIST + j] = inverse[i * UNKNOWNS + j];
}

sf_status sf_track_picture(sf_tracker *t, const sf_model *model, const sf_render_options *options,
                           const sf_rigid *guess, const sf_track_prior *prior, sf_track_guess how,
                           sf_track *track) {
    row_sums sums = {0};
    int close = how == SF_GUESS_CLOSE, drawings = close ? 1 : DRAWINGS,
        rounds = close ? ROUNDS_CLOSE : ROUNDS;
    int coarsest = (int)how < t->level_count ? (int)how : t->level_count - 1;
    *track = (sf_track){.pose = *guess};
    t->gain = 1, t->bias = 0, t->width = FIRST;
    for (int i = coarsest; i >= 0; i--)
        for (int drawing = 0; drawing < drawings; drawing++) {
            sf_rigid drawn = track->pose;
            sf_status status = draw(t, &t->levels[i], model, options, &drawn);
            if (status) return status;
            align(t, &drawn, prior, rounds, &sums, &track->pose);
            if (sums.moved <= (i ? 1 : REDRAW) * sums.count) break;
        }
    conclude(t, &sums, prior, track);
    return SF_OK;
}
