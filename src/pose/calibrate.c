/* calibrate.c - lens and poses from the views of a board, by robust least squares (README, P.2 to P.5). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../io/undistort.h"
#include "observations.h"

enum { N = SF_LENS_PARAMETERS, LEAST_VIEWS = 3, LEAST_CORNERS = 6, ROUNDS = 8, STEPS = 100 };

static const double REJECT = 4.5;        /* standard deviations beyond which a corner does not fit, */
static const double REJECT_PX = 0.25;    /* and px that it must be off at least */
static const double LEAST_SPREAD = 0.01; /* px: exact corners have none */
static const double LEAST_TILT = 8, LEAST_TURN = 5; /* degrees, of views that cannot tell a lens */
static const double WEAK_TURN = 15;                 /* degrees, of views that hardly can */
static const double LOOSE = 0.005, HOPELESS = 0.03; /* standard deviations of the focal length */
static const double DEGREES = 180 / 3.141592653589793;

sf_calibrate_options sf_calibrate_options_default(void) {
    return (sf_calibrate_options){.radial = 2, .tangential = 1};
}

typedef struct problem {
    sf_observations *s;
    sf_lens lens;
    int column[N]; /* of each parameter among those that are estimated; -1: fixed */
    int free;      /* how many are */
    double scale;  /* px, of the weights; 0: all are 1 */
    double *distances;
} problem;

static double *values(sf_lens *lens) { return &lens->fx; } /* eight doubles in a row */

static void choose_columns(problem *p, const sf_calibrate_options *o) {
    int estimated[N] = {
        1, 1, !o->fix_center, !o->fix_center, o->radial > 0, o->radial > 1, o->tangential, o->tangential};
    for (int i = 0; i < N; i++) p->column[i] = estimated[i] ? p->free++ : -1;
    if (!o->fix_aspect) return;
    p->column[1] = 0;
    for (int i = 2; i < N; i++) p->column[i] -= p->column[i] >= 0;
    p->free--;
}

/* A step of all parameters (README, P.4). */

/* out [free] or [free][columns]: the rows of `in` added up into the estimated ones. */
static void gather_rows(const problem *p, int columns, const double *in, double *out) {
    memset(out, 0, (size_t)(p->free * columns) * sizeof *out);
    for (int i = 0; i < N; i++)
        for (int j = 0; p->column[i] >= 0 && j < columns; j++)
            out[p->column[i] * columns + j] += in[i * columns + j];
}

/* S = U - W V^-1 W^T and b = -(e - W V^-1 g), S with its diagonal damped as U's is. Keeps each V's factor. 0
 * where a V is singular. */
static int reduce(problem *p, double damping, double S[N * N], double b[N]) {
    memset(S, 0, N * N * sizeof *S);
    memset(b, 0, N * sizeof *b);
    int n = p->free;
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        const sf_view_sums *sums = &view->sums;
        double rows[N * N], W[N * SF_TWIST], U[N * N], e[N], turned[N * N];
        if (view->rejected) continue;
        gather_rows(p, N, sums->lens, rows); /* rows, and with U's symmetry columns */
        for (int i = 0; i < N; i++)
            for (int j = 0; j < n; j++) turned[i * n + j] = rows[j * N + i];
        gather_rows(p, n, turned, U);
        gather_rows(p, 1, sums->d_lens, e);
        gather_rows(p, SF_TWIST, sums->cross, W);
        memcpy(view->factor, sums->twist, sizeof view->factor);
        for (int i = 0; i < SF_TWIST; i++) view->factor[i * SF_TWIST + i] *= 1 + damping;
        if (!sf_cholesky(SF_TWIST, view->factor)) return 0;
        for (int i = 0; i < n; i++) {
            double y[SF_TWIST]; /* row i of W V^-1 */
            memcpy(y, W + i * SF_TWIST, sizeof y);
            sf_cholesky_solve(SF_TWIST, view->factor, y);
            for (int j = 0; j < n; j++) {
                S[i * n + j] += U[i * n + j] * (i == j ? 1 + damping : 1);
                for (int k = 0; k < SF_TWIST; k++) S[i * n + j] -= y[k] * W[j * SF_TWIST + k];
            }
            b[i] -= e[i];
            for (int k = 0; k < SF_TWIST; k++) b[i] += y[k] * sums->d_twist[k];
        }
    }
    return 1;
}

/* p = V^-1 (-g - W^T a) for the step `a` of all eight parameters. */
static void back_substitute(const sf_observation *view, const double a[N], double twist[SF_TWIST]) {
    for (int k = 0; k < SF_TWIST; k++) {
        twist[k] = -view->sums.d_twist[k];
        for (int i = 0; i < N; i++) twist[k] -= view->sums.cross[i * SF_TWIST + k] * a[i];
    }
    sf_cholesky_solve(SF_TWIST, view->factor, twist);
}

/* Moves to `next`, lens and poses; 0 where there is no step. */
static int try_step(problem *p, double damping, sf_lens *next) {
    double S[N * N], b[N], a[N];
    if (!reduce(p, damping, S, b) || !sf_cholesky(p->free, S)) return 0;
    sf_cholesky_solve(p->free, S, b);
    *next = p->lens;
    for (int i = 0; i < N; i++) {
        a[i] = p->column[i] < 0 ? 0 : b[p->column[i]];
        values(next)[i] += a[i];
    }
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        double twist[SF_TWIST];
        if (view->rejected) continue;
        back_substitute(view, a, twist);
        view->next = view->pose;
        sf_rigid_move(&view->next, twist);
    }
    return sf_lens_is_valid(next);
}

/* The cost of the poses, or of the next ones, with their sums. */
static double evaluate(problem *p, const sf_lens *lens, int next) {
    double cost = 0;
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        sf_view_sums *sums = next ? &view->next_sums : &view->sums;
        if (view->rejected) continue;
        sf_view_sum(lens, next ? &view->next : &view->pose, &view->list, p->scale, SF_VIEW_ALL, sums);
        cost += sums->cost;
    }
    return cost;
}

static void accept(problem *p, const sf_lens *next) {
    p->lens = *next;
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        if (view->rejected) continue;
        view->pose = view->next;
        view->sums = view->next_sums;
    }
}

/* Levenberg and Marquardt. */
static void minimize(problem *p) {
    double cost = evaluate(p, &p->lens, 0), damping = 1e-3;
    for (int i = 0; i < STEPS && damping < 1e10; i++) {
        sf_lens next;
        double moved = try_step(p, damping, &next) ? evaluate(p, &next, 1) : INFINITY;
        if (!(moved < cost)) {
            damping *= 10;
            continue;
        }
        int done = cost - moved < 1e-10 * cost;
        accept(p, &next);
        cost = moved;
        damping = fmax(damping / 10, 1e-12);
        if (done) break;
    }
}

/* The start. */

/* Zhang's equations of one view for 1/f^2, the centre being the picture's middle: a x + b = 0 twice. */
static int focal_equations(const sf_observations *s, const sf_corner_list *list, double a[2], double b[2]) {
    double points[2 * SF_CORNERS_MOST], H[9], side = s->width > s->height ? s->width : s->height;
    for (size_t i = 0; i < list->count; i++) {
        points[2 * i] = (list->corners[i].pixel[0] - s->width / 2.0) / side;
        points[2 * i + 1] = (list->corners[i].pixel[1] - s->height / 2.0) / side;
    }
    if (!sf_homography(list->corners, points, list->count, H)) return 0;
    double size = H[0] * H[0] + H[1] * H[1] + H[3] * H[3] + H[4] * H[4];
    a[0] = (H[0] * H[1] + H[3] * H[4]) / size;
    b[0] = H[6] * H[7] / size;
    a[1] = (H[0] * H[0] + H[3] * H[3] - H[1] * H[1] - H[4] * H[4]) / size;
    b[1] = (H[6] * H[6] - H[7] * H[7]) / size;
    return 1;
}

/* In longer sides of the picture; 0: the views tell none. */
static double closed_form(const sf_observations *s) {
    double aa = 0, ab = 0;
    for (size_t v = 0; v < s->count; v++) {
        double a[2], b[2];
        if (!focal_equations(s, &s->views[v].list, a, b)) continue;
        for (int k = 0; k < 2; k++) {
            aa += a[k] * a[k];
            ab += a[k] * b[k];
        }
    }
    double focal = ab < 0 ? sqrt(-aa / ab) : 0;
    return focal > 0.1 && focal < 20 ? focal : 0;
}

/* Each view's pose through the lens; views that have none are rejected. Returns the cost. */
static double place_views(sf_observations *s, const sf_lens *lens) {
    double cost = 0, scale = 0.01 * lens->cx;
    for (size_t v = 0; v < s->count; v++) {
        sf_observation *view = &s->views[v];
        view->rejected = !sf_view_first_pose(lens, &view->list, &view->pose);
        if (!view->rejected) cost += sf_view_refine(lens, &view->list, scale, &view->pose);
    }
    return cost;
}

/* The closed form, or a usual focal length where one explains the views better. */
static void start(problem *p) {
    double focals[] = {closed_form(p->s), 0.7, 1, 1.5, 2.5}, best = INFINITY, focal = 1;
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        memset(view->list.rejected, 0, view->list.count);
        sf_shift_edges(view->corners, view->list.count, view->edge_bias.px);
        view->edge_bias = (sf_edge_bias){0};
    }
    for (size_t i = 0; i < sizeof focals / sizeof *focals; i++) {
        if (!(focals[i] > 0)) continue;
        sf_lens lens = sf_observations_guess(p->s, focals[i]);
        double cost = place_views(p->s, &lens);
        if (!(cost < best)) continue;
        best = cost;
        focal = focals[i];
    }
    p->lens = sf_observations_guess(p->s, focal);
    place_views(p->s, &p->lens);
}

/* What does not fit. */

/* The standard deviation of a coordinate, from the corners of all views that are not rejected. */
static double find_spread(problem *p) {
    size_t count = 0;
    for (size_t v = 0; v < p->s->count; v++) {
        const sf_observation *view = &p->s->views[v];
        if (view->rejected) continue;
        sf_view_distances(&p->lens, &view->pose, &view->list, p->distances + count);
        count += view->list.count;
    }
    return fmax(sf_spread(p->distances, count), LEAST_SPREAD);
}

/* Marks the corners that do not fit, and the views of which at most half does. */
static void reject(problem *p, double spread) {
    double limit = fmax(REJECT * spread, REJECT_PX);
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        size_t kept = 0;
        if (view->rejected) continue;
        sf_view_distances(&p->lens, &view->pose, &view->list, p->distances);
        for (size_t i = 0; i < view->list.count; i++)
            kept += !(view->list.rejected[i] = !(p->distances[i] <= limit));
        view->rejected = kept < LEAST_CORNERS || 2 * kept <= view->list.count;
    }
}

static size_t count_views(const sf_observations *s) {
    size_t count = 0;
    for (size_t v = 0; v < s->count; v++) count += !s->views[v].rejected;
    return count;
}

/* One for all views, the mean of what each tells: it is the camera's. */
static void estimate_edge_bias(problem *p) {
    double sum = 0, weights = 0;
    for (size_t v = 0; v < p->s->count; v++) {
        sf_observation *view = &p->s->views[v];
        if (view->rejected) continue;
        if (!sf_estimate_edge_bias(&p->lens, &view->pose, &view->list, view->corners, &view->edge_bias))
            continue;
        sum += view->edge_bias.px / view->edge_bias.variance, weights += 1 / view->edge_bias.variance;
    }
    for (size_t v = 0; v < p->s->count && weights > 0; v++) {
        sf_observation *view = &p->s->views[v];
        sf_shift_edges(view->corners, view->list.count, view->edge_bias.px - sum / weights);
        view->edge_bias.px = sum / weights;
    }
}

/* Robust rounds over all corners while the spread settles, then rejection, then rounds without what was
 * rejected, and without the edge bias; the last with all weights 1, so that the covariance is that of least
 * squares. */
static void fit(problem *p) {
    for (int round = 0; round < ROUNDS && count_views(p->s) >= LEAST_VIEWS; round++) {
        int settled = round >= ROUNDS / 2;
        if (settled) estimate_edge_bias(p);
        double spread = find_spread(p);
        if (settled) reject(p, spread);
        p->scale = round == ROUNDS - 1 ? 0 : SF_CAUCHY * spread;
        minimize(p);
    }
}

/* The result. */

static double angle_between(const double a[3], const double b[3]) {
    double across[3];
    sf_cross3(a, b, across);
    return atan2(sqrt(sf_dot3(across, across)), sf_dot3(a, b)) * DEGREES;
}

static void axis_of(const sf_observation *view, double axis[3]) {
    for (int i = 0; i < 3; i++) axis[i] = view->pose.R[3 * i + 2];
}

static void measure_tilts(const sf_observations *s, sf_calibration *c) {
    const double forward[3] = {0, 0, 1};
    for (size_t v = 0; v < s->count; v++) {
        double a[3], b[3];
        if (s->views[v].rejected) continue;
        axis_of(&s->views[v], a);
        c->tilt_most = fmax(c->tilt_most, angle_between(a, forward));
        for (size_t w = 0; w < v; w++) {
            axis_of(&s->views[w], b);
            if (!s->views[w].rejected) c->tilt_spread = fmax(c->tilt_spread, angle_between(a, b));
        }
    }
}

static void sum_up(const problem *p, sf_calibration *c) {
    const sf_observations *s = p->s;
    uint8_t cells[SF_CELLS] = {0};
    double squares = 0;
    for (size_t v = 0; v < s->count; v++) {
        const sf_observation *view = &s->views[v];
        if (view->rejected) {
            c->views_rejected++;
            continue;
        }
        double rms = sqrt(view->sums.squares / (double)view->sums.count);
        if (rms > c->worst_rms) c->worst_view = v;
        c->worst_rms = fmax(c->worst_rms, rms);
        squares += view->sums.squares;
        c->views++;
        c->corners += view->sums.count;
        c->corners_rejected += view->list.count - view->sums.count;
        sf_observations_mark(s, &view->list, cells);
    }
    c->rms = c->corners ? sqrt(squares / (double)c->corners) : 0;
    c->coverage = sf_cells_share(cells);
    measure_tilts(s, c);
}

/* 0 where the views leave a parameter open. */
static int find_sigma(problem *p, sf_calibration *c) {
    double S[N * N], b[N], inverse[N * N];
    double freedom = 2 * (double)c->corners - p->free - SF_TWIST * (double)c->views;
    double variance = freedom > 0 ? c->rms * c->rms * (double)c->corners / freedom : INFINITY;
    if (!reduce(p, 0, S, b) || !sf_cholesky(p->free, S)) return 0;
    sf_cholesky_invert(p->free, S, inverse);
    for (int i = 0; i < N; i++)
        if (p->column[i] >= 0) values(&c->sigma)[i] = sqrt(variance * inverse[p->column[i] * (p->free + 1)]);
    return isfinite(c->sigma.fx) && isfinite(c->sigma.fy);
}

static sf_status refuse_frontal(sf_context *ctx, const sf_calibration *c) {
    return sf_fail(ctx, SF_ERR_EMPTY,
                   "calibration: views: all %zu face the camera within %.0f degrees, which leaves the focal "
                   "length open: tilt the board by 20 to 45 degrees, to every side",
                   c->views, ceil(c->tilt_most));
}

static sf_status refuse_alike(sf_context *ctx, const sf_calibration *c) {
    return sf_fail(ctx, SF_ERR_EMPTY,
                   "calibration: views: all %zu have one tilt within %.0f degrees, which leaves the lens "
                   "open: tilt the board to other sides",
                   c->views, ceil(c->tilt_spread));
}

/* Views that tell little put the principal point anywhere. */
static int center_is_out(const sf_calibration *c) {
    return !(c->lens.cx > 0 && c->lens.cy > 0 && c->lens.cx < c->width && c->lens.cy < c->height);
}

static sf_status judge(const problem *p, int known, const sf_calibration *c) {
    sf_context *ctx = p->s->ctx;
    double sigma = fmax(c->sigma.fx / c->lens.fx, c->sigma.fy / c->lens.fy);
    if (c->tilt_most < LEAST_TILT) return refuse_frontal(ctx, c);
    if (c->tilt_spread < LEAST_TURN) return refuse_alike(ctx, c);
    if (!known || sigma > HOPELESS || center_is_out(c))
        return sf_fail(
            ctx, SF_ERR_EMPTY,
            "calibration: views: %zu, whose tilts differ by %.0f degrees, leave the lens open: tilt "
            "the board by 20 to 45 degrees, to every side, or fix the aspect, the centre, the distortion",
            c->views, c->tilt_spread);
    if (c->tilt_spread < WEAK_TURN)
        sf_log(ctx, SF_LOG_WARNING,
               "calibration: the tilts of the views differ by %.0f degrees at most: the lens is only as good "
               "as the board is flat; tilt it by 20 to 45 degrees, to every side",
               c->tilt_spread);
    else if (sigma > LOOSE)
        sf_log(
            ctx, SF_LOG_WARNING,
            "calibration: the focal length is known to +-%.1f %% only: tilt the board by 20 to 45 degrees, "
            "to every side",
            100 * sigma);
    return SF_OK;
}

static sf_status solve(problem *p, sf_calibration *c) {
    start(p);
    fit(p);
    size_t views = count_views(p->s);
    if (views < LEAST_VIEWS)
        return sf_fail(
            p->s->ctx, SF_ERR_EMPTY,
            "calibration: views: %zu of %zu fit, at least %d are needed, and 10 to 20 are good: show "
            "the board from more sides",
            views, p->s->count, LEAST_VIEWS);
    *c = (sf_calibration){.width = p->s->width, .height = p->s->height, .lens = p->lens};
    sum_up(p, c);
    return judge(p, find_sigma(p, c), c);
}

sf_status sf_calibrate(sf_observations *s, const sf_calibrate_options *options, sf_calibration *calibration) {
    sf_calibrate_options o = options ? *options : sf_calibrate_options_default();
    problem p = {.s = s};
    size_t corners = 0;
    memset(calibration, 0, sizeof *calibration);
    if (o.radial < 0 || o.radial > 2)
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "calibration: radial: %d is not in 0..2", o.radial);
    for (size_t v = 0; v < s->count; v++) corners += s->views[v].list.count;
    p.distances = sf_alloc(s->ctx, corners + 1, sizeof *p.distances);
    if (!p.distances) return SF_ERR_MEMORY;
    choose_columns(&p, &o);
    sf_status status = solve(&p, calibration);
    sf_free(s->ctx, p.distances);
    if (status) memset(calibration, 0, sizeof *calibration);
    return status;
}

sf_status sf_observations_get(const sf_observations *s, size_t index, sf_observation_info *info) {
    memset(info, 0, sizeof *info);
    if (index >= s->count) return SF_ERR_END;
    const sf_observation *view = &s->views[index];
    info->rejected = view->rejected;
    info->corners = view->list.count;
    info->corners_rejected = view->rejected ? 0 : view->list.count - view->sums.count;
    if (!view->rejected && view->sums.count) info->rms = sqrt(view->sums.squares / (double)view->sums.count);
    memcpy(info->R_cb, view->pose.R, sizeof info->R_cb);
    memcpy(info->t_cb, view->pose.t, sizeof info->t_cb);
    return SF_OK;
}
