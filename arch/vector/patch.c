/* patch.c - gradients about points of a level, by direction alone and by place and direction: lanes = points.
 * The operations of arch/scalar/patch.c in their order, none of them fused, so that the floats are the same.
 */
#include "../scalar/patch.h"
#include "kernels.h"

#include "vec.h"

/* The points of some lanes, and where their places end. */
typedef struct points {
    vf x, y, a, b;
    vf last_x, last_y, most_x, most_y; /* of places, and of the upper left of four pixels */
    vf stride;
} points;

VEC points points_of(const sf_patch_args *args, size_t lane) {
    return (points){vf_loadu(args->x + lane),         vf_loadu(args->y + lane),
                    vf_loadu(args->a + lane),         vf_loadu(args->b + lane),
                    vf_set((float)(args->width - 1)), vf_set((float)(args->height - 1)),
                    vf_set((float)(args->width - 2)), vf_set((float)(args->height - 2)),
                    vf_set((float)args->stride)};
}

VEC vf between(vf from, vf to, vf share) { return vf_add(from, vf_mul(share, vf_sub(to, from))); }

/* 1. Row j of the samples. */
VEC void take_row(const sf_patch_args *args, const points *p, int j, vf row[SF_PATCH]) {
    vf zero = vf_set(0), v = vf_set((float)j - 7.5f);
    vf x0 = vf_sub(p->x, vf_mul(v, p->b)), y0 = vf_add(p->y, vf_mul(v, p->a));
    vu stride = vu_set((uint32_t)args->stride);
    for (int i = 0; i < SF_PATCH; i++) {
        vf u = vf_set((float)i - 7.5f);
        vf x = vf_min(vf_max(vf_add(x0, vf_mul(u, p->a)), zero), p->last_x);
        vf y = vf_min(vf_max(vf_add(y0, vf_mul(u, p->b)), zero), p->last_y);
        vf column = vf_min(vf_floor(x), p->most_x), line = vf_min(vf_floor(y), p->most_y);
        vu at = vf_whole(vf_add(vf_mul(line, p->stride), column)); /* exact: below 2^24 */
        vf right = vf_sub(x, column), down = vf_sub(y, line), p0, p1, q0, q1;
        vf_gather2(args->pixels, at, &p0, &p1);
        vf_gather2(args->pixels, vu_add(at, stride), &q0, &q1);
        row[i] = between(between(p0, p1, right), between(q0, q1, right), down);
    }
}

typedef struct gradient {
    vf along, down, ax, ay;
} gradient;

VEC vf absolute(vf a) { return vf_max(a, vf_sub(vf_set(0), a)); }

/* 2. Of four samples, from their diagonals. */
VEC gradient gradient_of(const vf *above, const vf *below, int i) {
    vf p = vf_sub(below[i + 1], above[i]), q = vf_sub(above[i + 1], below[i]);
    vf along = vf_add(p, q), down = vf_sub(p, q);
    return (gradient){along, down, absolute(along), absolute(down)};
}

/* The two nearest directions of 32 of a row's gradients, and the parts along them. */
typedef struct directions {
    _Alignas(64) uint32_t bin[SF_GRADIENTS][2][VW];
    _Alignas(64) float part[SF_GRADIENTS][2][VW];
} directions;

/* 3. */
VEC void by_direction(const gradient *g, float weight, directions *d, int i) {
    vf most = vf_max(g->ax, g->ay), least = vf_min(g->ax, g->ay), w = vf_set(weight);
    vf k = vf_set(0), step = vf_set(1), s0 = vf_set(sf_direction_sin[0]), s1 = vf_set(sf_direction_sin[1]);
    vf c0 = vf_set(sf_direction_cos[0]), c1 = vf_set(sf_direction_cos[1]);
    for (int t = 0; t < 3; t++) {
        vm beyond = vf_ge(least, vf_mul(most, vf_set(sf_direction_tan[t])));
        k = vf_select(beyond, vf_set((float)t + 1), k);
        s0 = vf_select(beyond, vf_set(sf_direction_sin[t + 1]), s0);
        s1 = vf_select(beyond, vf_set(sf_direction_sin[t + 2]), s1);
        c0 = vf_select(beyond, vf_set(sf_direction_cos[t + 1]), c0);
        c1 = vf_select(beyond, vf_set(sf_direction_cos[t + 2]), c1);
    }
    vf first = vf_mul(vf_sub(vf_mul(most, s1), vf_mul(least, c1)), w);
    vf second = vf_mul(vf_sub(vf_mul(least, c0), vf_mul(most, s0)), w);
    vm flat = vf_ge(g->ax, g->ay), forth = vf_ge(g->along, vf_set(0)), down = vf_ge(g->down, vf_set(0));
    k = vf_select(flat, k, vf_sub(vf_set(8), k)), step = vf_select(flat, step, vf_neg(step));
    k = vf_select(forth, k, vf_sub(vf_set(16), k)), step = vf_select(forth, step, vf_neg(step));
    k = vf_select(down, k, vf_sub(vf_set(32), k)), step = vf_select(down, step, vf_neg(step));
    vu turn = vu_set(SF_ORIENTATIONS - 1);
    vu_store(d->bin[i][0], vu_and(vf_whole(k), turn));
    vu_store(d->bin[i][1], vu_and(vf_whole(vf_add(k, step)), turn));
    vf_store(d->part[i][0], first);
    vf_store(d->part[i][1], second);
}

VEC void orient_lanes(const sf_patch_args *args, size_t lane) {
    points p = points_of(args, lane);
    float *out = args->out + lane;
    vf rows[2][SF_PATCH];
    for (int k = 0; k < SF_ORIENTATIONS; k++) vf_store(out + k * SF_LANES, vf_set(0));
    take_row(args, &p, 0, rows[0]);
    for (int j = 0; j < SF_GRADIENTS; j++) {
        const vf *above = rows[j % 2], *below = rows[(j + 1) % 2];
        directions d;
        take_row(args, &p, j + 1, rows[(j + 1) % 2]);
        for (int i = 0; i < SF_GRADIENTS; i++) {
            gradient g = gradient_of(above, below, i);
            by_direction(&g, sf_near_middle[j] * sf_near_middle[i], &d, i);
        }
        for (int n = 0; n < 2 * SF_GRADIENTS; n++)
            for (int l = 0; l < VW; l++)
                out[d.bin[n / 2][n % 2][l] * SF_LANES + (uint32_t)l] += d.part[n / 2][n % 2][l];
    }
}

void SF_AT_LEVEL(sf_orient)(const sf_patch_args *args) {
    for (size_t lane = 0; lane < args->count; lane += VW) orient_lanes(args, lane);
}

/* 4. The parts along the two nearest directions of 8. */
VEC void parts_of(const gradient *g, vf parts[SF_DIRECTIONS]) {
    vf zero = vf_set(0);
    vf level = vf_max(vf_sub(g->ax, g->ay), zero), upright = vf_max(vf_sub(g->ay, g->ax), zero);
    vf diagonal = vf_mul(vf_min(g->ax, g->ay), vf_set(SF_ROOT_2));
    vm forth = vf_ge(g->along, zero), down = vf_ge(g->down, zero);
    vf ahead = vf_keep(forth, diagonal), back = vf_sub(diagonal, ahead);
    parts[0] = vf_keep(forth, level), parts[4] = vf_sub(level, parts[0]);
    parts[2] = vf_keep(down, upright), parts[6] = vf_sub(upright, parts[2]);
    parts[1] = vf_keep(down, ahead), parts[7] = vf_sub(ahead, parts[1]);
    parts[3] = vf_keep(down, back), parts[5] = vf_sub(back, parts[3]);
}

/* 6. A cell's sums of row j to the cells over one another in its column. */
VEC void add_to_cells(float *out, int j, int column, const vf sums[SF_DIRECTIONS]) {
    for (int side = 0; side < 2; side++) {
        int cell = j / 3 - 1 + side;
        if (cell < 0 || cell >= SF_CELLS) continue;
        float *to = out + (cell * SF_CELLS + column) * SF_DIRECTIONS * SF_LANES;
        vf share = vf_set(sf_cell_share[j][side]);
        for (int k = 0; k < SF_DIRECTIONS; k++)
            vf_store(to + k * SF_LANES, vf_add(vf_load(to + k * SF_LANES), vf_mul(share, sums[k])));
    }
}

/* 5. Sums of a row by columns of cells: three gradients share two cells, of which one then has all. */
VEC void add_row(const vf *above, const vf *below, int j, float *out) {
    vf left[SF_DIRECTIONS], right[SF_DIRECTIONS], parts[SF_DIRECTIONS];
    for (int k = 0; k < SF_DIRECTIONS; k++) right[k] = vf_set(0);
    for (int i = 0; i < SF_GRADIENTS; i += 3) {
        for (int k = 0; k < SF_DIRECTIONS; k++) left[k] = right[k], right[k] = vf_set(0);
        for (int n = i; n < i + 3; n++) {
            gradient g = gradient_of(above, below, n);
            parts_of(&g, parts);
            vf to_left = vf_set(sf_cell_share[n][0]), to_right = vf_set(sf_cell_share[n][1]);
            for (int k = 0; k < SF_DIRECTIONS; k++) left[k] = vf_add(left[k], vf_mul(to_left, parts[k]));
            for (int k = 0; k < SF_DIRECTIONS; k++) right[k] = vf_add(right[k], vf_mul(to_right, parts[k]));
        }
        if (i) add_to_cells(out, j, i / 3 - 1, left);
    }
}

VEC void describe_lanes(const sf_patch_args *args, size_t lane) {
    points p = points_of(args, lane);
    float *out = args->out + lane;
    vf rows[2][SF_PATCH];
    for (int k = 0; k < SF_DESCRIPTOR; k++) vf_store(out + k * SF_LANES, vf_set(0));
    take_row(args, &p, 0, rows[0]);
    for (int j = 0; j < SF_GRADIENTS; j++) {
        take_row(args, &p, j + 1, rows[(j + 1) % 2]);
        add_row(rows[j % 2], rows[(j + 1) % 2], j, out);
    }
}

void SF_AT_LEVEL(sf_describe)(const sf_patch_args *args) {
    for (size_t lane = 0; lane < args->count; lane += VW) describe_lanes(args, lane);
}
