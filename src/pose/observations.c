/* observations.c - collects the views of a calibration, and says which are missing (README, P.5). */
#include "observations.h"

#include <math.h>
#include <string.h>

enum { LEAST_SIDE = 16, MOST_SIDE = 65535, LEAST_CORNERS = 4, LEAST_OFFERED = 8, MOST_VIEWS = 2000 };

/* Two views closer than this tell the same twice (widths of the picture, logarithm, sine). */
static const double NOVEL = 0.15;

sf_status sf_observations_create(sf_context *ctx, int32_t width, int32_t height,
                                 sf_observations **observations) {
    *observations = NULL;
    if (width < LEAST_SIDE || height < LEAST_SIDE || width > MOST_SIDE || height > MOST_SIDE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "calibration: pictures: %d x %d is not in %d..%d px", (int)width,
                       (int)height, LEAST_SIDE, MOST_SIDE);
    sf_observations *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    s->width = width;
    s->height = height;
    *observations = s;
    return SF_OK;
}

void sf_observations_destroy(sf_observations **observations) {
    sf_observations *s = *observations;
    if (!s) return;
    for (size_t i = 0; i < s->count; i++) sf_free(s->ctx, s->views[i].corners);
    sf_free(s->ctx, s->views);
    sf_free(s->ctx, s);
    *observations = NULL;
}

size_t sf_observations_count(const sf_observations *s) { return s->count; }

sf_lens sf_observations_guess(const sf_observations *s, double focal) {
    double f = focal * (s->width > s->height ? s->width : s->height);
    return (sf_lens){.fx = f, .fy = f, .cx = s->width / 2.0, .cy = s->height / 2.0};
}

/* Cells. */

size_t sf_observations_mark(const sf_observations *s, const sf_corner_list *list, uint8_t cells[SF_CELLS]) {
    size_t fresh = 0;
    for (size_t i = 0; i < list->count; i++) {
        const double *pixel = list->corners[i].pixel;
        double x = pixel[0] * SF_CELLS_X / s->width, y = pixel[1] * SF_CELLS_Y / s->height;
        if (list->rejected && list->rejected[i]) continue;
        if (!(x >= 0 && y >= 0 && x < SF_CELLS_X && y < SF_CELLS_Y)) continue;
        uint8_t *cell = &cells[(int)y * SF_CELLS_X + (int)x];
        fresh += !*cell;
        *cell = 1;
    }
    return fresh;
}

/* Of the cells from column x0 and row y0 up to x1 and y1. */
static double share(const uint8_t cells[SF_CELLS], int x0, int y0, int x1, int y1) {
    int marked = 0;
    for (int y = y0; y < y1; y++)
        for (int x = x0; x < x1; x++) marked += cells[y * SF_CELLS_X + x];
    return (double)marked / ((x1 - x0) * (y1 - y0));
}

double sf_cells_share(const uint8_t cells[SF_CELLS]) { return share(cells, 0, 0, SF_CELLS_X, SF_CELLS_Y); }

double sf_observations_coverage(const sf_observations *s) { return sf_cells_share(s->cells); }

/* Adding. */

static sf_status check_corners(const sf_observations *s, const sf_board_corner *corners, size_t count) {
    if (count < LEAST_CORNERS || count > SF_CORNERS_MOST)
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "calibration: corners: %zu is not in %d..%d", count,
                       LEAST_CORNERS, SF_CORNERS_MOST);
    for (size_t i = 0; i < count; i++) {
        const double *p = corners[i].pixel, *b = corners[i].board;
        if (p[0] >= -s->width && p[1] >= -s->height && p[0] <= 2.0 * s->width && p[1] <= 2.0 * s->height &&
            isfinite(b[0]) && isfinite(b[1]))
            continue;
        return sf_fail(s->ctx, SF_ERR_ARGUMENT,
                       "calibration: corner %d of tag %d: %g, %g is not in a picture of %d x %d px",
                       (int)corners[i].corner, (int)corners[i].id, p[0], p[1], (int)s->width, (int)s->height);
    }
    return SF_OK;
}

/* 0 if the corners have no pose. */
static int find_stance(const sf_observations *s, const sf_corner_list *list, sf_stance *stance) {
    sf_lens lens = sf_observations_guess(s, 1);
    sf_rigid T;
    double middle[3] = {0}, n = (double)list->count;
    if (!sf_view_first_pose(&lens, list, &T)) return 0;
    *stance = (sf_stance){.tilt = {T.R[2], T.R[5]}};
    for (size_t i = 0; i < list->count; i++) {
        stance->x += list->corners[i].pixel[0] / s->width / n;
        stance->y += list->corners[i].pixel[1] / s->height / n;
        for (int k = 0; k < 2; k++) middle[k] += list->corners[i].board[k] / n;
    }
    double distance = T.R[6] * middle[0] + T.R[7] * middle[1] + T.t[2];
    stance->log_distance = distance > 0 ? log(distance) : 0;
    return distance > 0;
}

static sf_status add(sf_observations *s, const sf_board_corner *corners, size_t count,
                     const sf_stance *stance) {
    if (s->count == MOST_VIEWS)
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "calibration: more than %d views", MOST_VIEWS);
    sf_status status = sf_grow(s->ctx, &s->views, &s->capacity, s->count, s->count + 1, sizeof *s->views);
    if (status) return status;
    sf_observation *view = &s->views[s->count];
    memset(view, 0, sizeof *view);
    view->corners = sf_alloc(s->ctx, count, sizeof *view->corners + 1);
    if (!view->corners) return SF_ERR_MEMORY;
    memcpy(view->corners, corners, count * sizeof *corners);
    view->list = (sf_corner_list){view->corners, (uint8_t *)(view->corners + count), count};
    memset(view->list.rejected, 0, count);
    view->stance = *stance;
    s->count++;
    sf_observations_mark(s, &view->list, s->cells);
    return SF_OK;
}

sf_status sf_observations_add(sf_observations *s, const sf_board_corner *corners, size_t count) {
    sf_stance stance = {0};
    sf_status status = check_corners(s, corners, count);
    if (status) return status;
    find_stance(s, &(sf_corner_list){corners, NULL, count}, &stance);
    return add(s, corners, count, &stance);
}

static double difference(const sf_stance *a, const sf_stance *b) {
    return fabs(a->x - b->x) + fabs(a->y - b->y) + fabs(a->log_distance - b->log_distance) +
           fabs(a->tilt[0] - b->tilt[0]) + fabs(a->tilt[1] - b->tilt[1]);
}

static int is_novel(const sf_observations *s, const sf_stance *stance) {
    for (size_t i = 0; i < s->count; i++)
        if (difference(&s->views[i].stance, stance) < NOVEL) return 0;
    return 1;
}

sf_status sf_observations_offer(sf_observations *s, const sf_board_corner *corners, size_t count,
                                int *taken) {
    sf_stance stance;
    uint8_t cells[SF_CELLS];
    sf_corner_list list = {corners, NULL, count};
    *taken = 0;
    if (count < LEAST_OFFERED) return SF_OK;
    sf_status status = check_corners(s, corners, count);
    if (status || s->count == MOST_VIEWS || !find_stance(s, &list, &stance)) return status;
    memcpy(cells, s->cells, sizeof cells);
    if (!sf_observations_mark(s, &list, cells) && !is_novel(s, &stance)) return SF_OK;
    status = add(s, corners, count, &stance);
    *taken = !status;
    return status;
}

/* What is missing. */

typedef struct range {
    double least, most;
} range;

static void widen(range *r, double value) {
    r->least = fmin(r->least, value);
    r->most = fmax(r->most, value);
}

const char *sf_observations_advice(const sf_observations *s) {
    enum { ENOUGH_VIEWS = 10 };
    const double half = 0.5, sine = 0.25, stretch = log(1.3);
    range x = {0, 0}, y = {0, 0}, distance = {INFINITY, -INFINITY};
    if (!s->count) return "show the board to the camera";
    for (size_t i = 0; i < s->count; i++) {
        widen(&x, s->views[i].stance.tilt[0]);
        widen(&y, s->views[i].stance.tilt[1]);
        widen(&distance, s->views[i].stance.log_distance);
    }
    /* The axis points into the board: where it points to the right, the right edge is near. */
    if (x.most < sine) return "tilt the board: its right edge towards the camera";
    if (x.least > -sine) return "tilt the board: its left edge towards the camera";
    if (y.most < sine) return "tilt the board: its lower edge towards the camera";
    if (y.least > -sine) return "tilt the board: its upper edge towards the camera";
    if (share(s->cells, 0, 0, 2, SF_CELLS_Y) < half) return "move the board to the left of the picture";
    if (share(s->cells, SF_CELLS_X - 2, 0, SF_CELLS_X, SF_CELLS_Y) < half)
        return "move the board to the right of the picture";
    if (share(s->cells, 0, 0, SF_CELLS_X, 2) < half) return "move the board to the top of the picture";
    if (share(s->cells, 0, SF_CELLS_Y - 2, SF_CELLS_X, SF_CELLS_Y) < half)
        return "move the board to the bottom of the picture";
    if (distance.most - distance.least < stretch) return "hold the board nearer, and farther away";
    return s->count < ENOUGH_VIEWS ? "hold the board at more places" : NULL;
}
