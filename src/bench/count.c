/* count.c - how much blending a workspace's lists are, in float64. */
#include <math.h>
#include <string.h>

#include "exact.h"
#include "scene.h"

/* One tile, cut into blocks. */
typedef struct tile {
    int x0, y0;        /* first pixel */
    int columns, rows; /* of a block */
    double T[SF_TILE_PIXELS];
    uint8_t finished[SF_TILE_PIXELS];
    int open[SF_TILE_PIXELS]; /* pixels of each block that are not finished */
} tile;

static void start_tile(tile *t, int x0, int y0, int columns, int rows) {
    *t = (tile){.x0 = x0, .y0 = y0, .columns = columns, .rows = rows};
    for (int i = 0; i < SF_TILE_PIXELS; i++) {
        t->T[i] = 1;
        t->open[i] = columns * rows;
    }
}

/* All pixels of a block that a Gaussian reaches. */
static void count_block(tile *t, int block, int x, int y, const sf_splat *s, bench_pairs *pairs) {
    pairs->evaluated += t->columns * t->rows;
    for (int row = y; row < y + t->rows; row++)
        for (int column = x; column < x + t->columns; column++) {
            int px = row * SF_TILE + column;
            if (t->finished[px]) continue;
            exact_pair p = exact_evaluate(s, t->x0 + column, t->y0 + row);
            if (!p.visible) continue;
            double next = t->T[px] * (1 - p.alpha);
            if (next < (double)SF_T_STOP) {
                t->finished[px] = 1;
                t->open[block]--;
                continue;
            }
            t->T[px] = next;
            pairs->contributing++;
        }
}

static void count_entry(tile *t, const sf_splat *s, bench_pairs *pairs) {
    int across = SF_TILE / t->columns;
    for (int y = 0; y < SF_TILE; y += t->rows) {
        double left, right, top = t->y0 + y + 0.5 - (double)s->v;
        if (!exact_interval(s, top, top + t->rows - 1, &left, &right)) continue;
        for (int x = 0; x < SF_TILE; x += t->columns) {
            int block = y / t->rows * across + x / t->columns;
            double first = t->x0 + x + 0.5;
            if (t->open[block] && right >= first && left <= first + t->columns - 1)
                count_block(t, block, x, y, s, pairs);
        }
    }
}

bench_pairs bench_count_pairs(const sf_workspace *ws, int columns, int rows) {
    bench_pairs pairs = {0, 0};
    int tiles = ws->eye.tiles_x * ws->eye.tiles_y;
    for (int i = 0; i < tiles; i++) {
        tile t;
        start_tile(&t, i % ws->eye.tiles_x * SF_TILE, i / ws->eye.tiles_x * SF_TILE, columns, rows);
        for (uint32_t e = ws->tile_begin[i]; e < ws->tile_begin[i + 1]; e++)
            count_entry(&t, &ws->splats[ws->entries[e]], &pairs);
    }
    return pairs;
}
