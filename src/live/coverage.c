/* coverage.c - see coverage.h. */
#include "coverage.h"

#include <math.h>
#include <string.h>

/* Enough of each: keyframes, spread of directions (rad), error; and an error at which nothing is covered. */
#define ENOUGH_VIEWS  5.0
#define ENOUGH_SPREAD 0.2
#define SMALL_ERROR   0.04
#define LARGE_ERROR   0.16

/* Of a region: pixels of all keyframes, cells; and coverage from which on it needs no more. */
enum { REGION_PIXELS = 12, REGION_CELLS = 3 };
#define COVERED 0.8
#define STAYS   0.15 /* better than the worst, and chosen on */

/* Depths of neighbours differ by less than this part on one surface. */
#define SURFACE 0.15f

/* 1. Cells */

void sf_coverage_clear(sf_coverage *c, double side, double far) {
    c->side = side, c->far = far;
    c->count = 0, c->has_worst = 0;
    if (c->table) memset(c->table, 0, c->table_size * sizeof *c->table);
    for (size_t i = 0; i < c->view_count; i++) sf_free(c->ctx, c->views[i].shares);
    c->view_count = 0;
}

void sf_coverage_free(sf_coverage *c) {
    sf_coverage_clear(c, 0, 0);
    sf_free(c->ctx, c->cells);
    sf_free(c->ctx, c->table);
    sf_free(c->ctx, c->views);
}

/* The entry of the table where the cell is, or would be. */
static size_t slot_of(const sf_coverage *c, const int32_t at[3]) {
    uint32_t hash =
        (uint32_t)at[0] * 0x9e3779b1u ^ (uint32_t)at[1] * 0x85ebca77u ^ (uint32_t)at[2] * 0xc2b2ae3du;
    size_t slot = (hash ^ hash >> 15) & (c->table_size - 1);
    while (c->table[slot] && memcmp(c->cells[c->table[slot] - 1].at, at, 3 * sizeof *at) != 0)
        slot = (slot + 1) & (c->table_size - 1);
    return slot;
}

static const sf_coverage_cell *find(const sf_coverage *c, const int32_t at[3]) {
    if (!c->table) return NULL;
    uint32_t found = c->table[slot_of(c, at)];
    return found && c->cells[found - 1].views ? &c->cells[found - 1] : NULL;
}

/* 0: too far from 0. */
static int grid_of(const sf_coverage *c, const double place[3], int32_t at[3]) {
    for (int k = 0; k < 3; k++) {
        double cell = floor(place[k] / c->side);
        if (!(fabs(cell) < 1e9)) return 0;
        at[k] = (int32_t)cell;
    }
    return 1;
}

const sf_coverage_cell *sf_coverage_at(const sf_coverage *c, const double place[3]) {
    int32_t at[3];
    return c->side > 0 && grid_of(c, place, at) ? find(c, at) : NULL;
}

/* The table stays at most half full. */
static sf_status make_table(sf_coverage *c) {
    if (c->table) return SF_OK;
    c->table_size = 2 * SF_COVERAGE_MOST;
    c->table = sf_calloc(c->ctx, c->table_size, sizeof *c->table);
    return c->table ? SF_OK : SF_ERR_MEMORY;
}

/* The index of the cell, which is made where there is none; UINT32_MAX: there are too many, or no memory. */
static uint32_t cell_of(sf_coverage *c, const int32_t at[3]) {
    size_t slot = slot_of(c, at);
    if (c->table[slot]) return c->table[slot] - 1;
    if (c->count == SF_COVERAGE_MOST ||
        sf_grow(c->ctx, &c->cells, &c->capacity, c->count, c->count + 1, sizeof *c->cells))
        return UINT32_MAX;
    c->cells[c->count] = (sf_coverage_cell){.at = {at[0], at[1], at[2]}};
    c->table[slot] = (uint32_t)++c->count;
    return c->table[slot] - 1;
}

/* 2. What keyframes see */

void sf_coverage_place(const sf_camera *c, int x, int y, double depth, double place[3]) {
    double q[3] = {(x + 0.5 - c->cx) / c->fx * depth, (y + 0.5 - c->cy) / c->fy * depth, depth};
    for (int k = 0; k < 3; k++) q[k] -= c->t_cw[k];
    for (int k = 0; k < 3; k++) place[k] = c->R_cw[k] * q[0] + c->R_cw[3 + k] * q[1] + c->R_cw[6 + k] * q[2];
}

/* A depth between those of two surfaces is that of none. */
static int is_surface(const sf_depth_map *m, int x, int y) {
    int width = m->camera->width;
    const float *at = m->depth + (size_t)y * (size_t)width + x;
    if (!(*at > 0)) return 0;
    if (x + 1 < width && fabsf(at[1] - *at) > SURFACE * *at) return 0;
    return y + 1 == m->camera->height || fabsf(at[width] - *at) <= SURFACE * *at;
}

static int sector_of(const float direction[3]) {
    int axis = 0, corner = 0;
    float sum = 0;
    for (int k = 0; k < 3; k++) {
        if (fabsf(direction[k]) > fabsf(direction[axis])) axis = k;
        corner |= (direction[k] > 0) << k;
        sum += fabsf(direction[k]);
    }
    return sum * 0.57735027f > fabsf(direction[axis]) ? 6 + corner : 2 * axis + (direction[axis] > 0);
}

static void add(sf_coverage *c, const sf_coverage_share *s, int sign) {
    sf_coverage_cell *cell = &c->cells[s->cell];
    cell->views += (uint32_t)sign;
    cell->pixels += (uint32_t)sign * s->pixels;
    cell->sectors[sector_of(s->direction)] += (uint16_t)sign;
    for (int k = 0; k < 3; k++) cell->direction[k] += sign * (double)s->direction[k];
    cell->error += sign * (double)s->error;
}

static sf_coverage_view *view_of(const sf_coverage *c, uint32_t id) {
    for (size_t i = 0; i < c->view_count; i++)
        if (c->views[i].id == id) return &c->views[i];
    return NULL;
}

int sf_coverage_has(const sf_coverage *c, uint32_t id) { return view_of(c, id) != NULL; }

static void take_out(sf_coverage *c, sf_coverage_view *v) {
    for (size_t i = 0; i < v->count; i++) add(c, &v->shares[i], -1);
    v->count = 0;
}

void sf_coverage_drop(sf_coverage *c, uint32_t id) {
    sf_coverage_view *v = view_of(c, id);
    if (!v) return;
    take_out(c, v);
    sf_free(c->ctx, v->shares);
    *v = c->views[--c->view_count];
}

static sf_status add_pixel(sf_coverage *c, sf_coverage_view *v, uint32_t cell, float error) {
    size_t i = v->count; /* neighbours lie in one cell as a rule, and the row above is not far back */
    while (i > 0 && v->shares[i - 1].cell != cell) i--;
    if (!i) {
        sf_status status =
            sf_grow(c->ctx, &v->shares, &v->capacity, v->count, v->count + 1, sizeof *v->shares);
        if (status) return status;
        v->shares[v->count++] = (sf_coverage_share){.cell = cell};
        i = v->count;
    }
    v->shares[i - 1].pixels++;
    v->shares[i - 1].error += error;
    return SF_OK;
}

static sf_status add_pixels(sf_coverage *c, sf_coverage_view *v, const sf_depth_map *m) {
    sf_status status = SF_OK;
    for (int y = 0; y < m->camera->height; y++)
        for (int x = 0; x < m->camera->width && !status; x++) {
            size_t i = (size_t)y * (size_t)m->camera->width + (size_t)x;
            double place[3];
            int32_t at[3];
            if (!is_surface(m, x, y) || (double)m->depth[i] > c->far) continue;
            sf_coverage_place(m->camera, x, y, (double)m->depth[i], place);
            uint32_t cell = grid_of(c, place, at) ? cell_of(c, at) : UINT32_MAX;
            if (cell != UINT32_MAX) status = add_pixel(c, v, cell, m->error[i]);
        }
    return status;
}

static void finish(const sf_coverage *c, sf_coverage_share *s, const double eye[3]) {
    double to[3], length = 0;
    for (int k = 0; k < 3; k++) {
        to[k] = eye[k] - (c->cells[s->cell].at[k] + 0.5) * c->side;
        length += to[k] * to[k];
    }
    for (int k = 0; k < 3; k++) s->direction[k] = (float)(to[k] / fmax(sqrt(length), 1e-30));
    s->error /= (float)s->pixels;
}

sf_status sf_coverage_see(sf_coverage *c, uint32_t id, const sf_depth_map *map) {
    sf_status status = make_table(c);
    double eye[3];
    if (!status && !view_of(c, id)) {
        status =
            sf_grow(c->ctx, &c->views, &c->view_capacity, c->view_count, c->view_count + 1, sizeof *c->views);
        if (!status) c->views[c->view_count++] = (sf_coverage_view){.id = id};
    }
    if (status) return status;
    sf_coverage_view *v = view_of(c, id);
    take_out(c, v);
    status = add_pixels(c, v, map);
    sf_camera_center(map->camera, eye);
    if (status) v->count = 0;
    for (size_t i = 0; i < v->count; i++) finish(c, &v->shares[i], eye), add(c, &v->shares[i], 1);
    return status;
}

/* 3. What is told */

void sf_coverage_tell(const sf_coverage *c, const sf_coverage_cell *cell, sf_live_cell *told) {
    double length = 0, views = cell->views;
    *told = (sf_live_cell){.views = cell->views};
    for (int k = 0; k < 3; k++) {
        told->center[k] = (float)((cell->at[k] + 0.5) * c->side);
        length += cell->direction[k] * cell->direction[k];
    }
    for (int i = 0; i < SF_COVERAGE_SECTORS; i++) told->sectors |= (uint32_t)(cell->sectors[i] > 0) << i;
    if (!cell->views) return;
    told->spread = (float)acos(fmin(sqrt(length) / views, 1));
    told->error = (float)fmax(cell->error / views, 0);
    double least = fmin(views / ENOUGH_VIEWS, (double)told->spread / ENOUGH_SPREAD);
    double clear = (LARGE_ERROR - (double)told->error) / (LARGE_ERROR - SMALL_ERROR);
    told->coverage = (float)fmin(fmax(fmin(least, clear), 0), 1);
}

/* The mean of a cell's coverage and its neighbours'; 2: too little of it is seen to be a part of the scene.
 */
static double about(const sf_coverage *c, size_t index) {
    static const int steps[][3] = {{0, 0, 0},  {1, 0, 0}, {-1, 0, 0}, {0, 1, 0},
                                   {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    const sf_coverage_cell *cell = &c->cells[index];
    double sum = 0;
    size_t n = 0, pixels = 0;
    if (!cell->views) return 2;
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        int32_t at[3] = {cell->at[0] + steps[i][0], cell->at[1] + steps[i][1], cell->at[2] + steps[i][2]};
        const sf_coverage_cell *near = find(c, at);
        sf_live_cell told;
        if (!near) continue;
        sf_coverage_tell(c, near, &told);
        sum += (double)told.coverage, pixels += near->pixels, n++;
    }
    return n >= REGION_CELLS && pixels >= REGION_PIXELS ? sum / (double)n : 2;
}

void sf_coverage_choose_worst(sf_coverage *c) {
    size_t worst = 0;
    double least = 2, before = c->has_worst ? about(c, c->worst) : 2;
    for (size_t i = 0; i < c->count; i++) {
        double here = about(c, i);
        if (here < least) least = here, worst = i;
    }
    if (before < COVERED && before < least + STAYS) return;
    c->has_worst = least < COVERED;
    c->worst = worst;
}
