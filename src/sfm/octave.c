/* octave.c - one octave of a scale space that goes through the picture row by row. */
#include "octave.h"

#include <math.h>

#include "elementary.h"
#include "localize.h"

/* Steps that a point may go from where it was found, and rows to both sides that are needed for it. */
enum { MOST_MOVES = 5, MARGIN = MOST_MOVES + 1 };

/* An offset of more than this means that a neighbour is nearer. */
#define NEARER 0.6

sf_taps sf_taps_of(double deviation) {
    sf_taps t = {.radius = (int)ceil(3 * deviation)};
    double weights[SF_BLUR_RADIUS + 1], sum = 0;
    for (int k = 0; k <= t.radius; k++) {
        weights[k] = sf_plain_exp(-0.5 * k * k / (deviation * deviation));
        sum += k ? 2 * weights[k] : weights[k];
    }
    for (int k = 0; k <= t.radius; k++) t.weights[k] = (float)(weights[k] / sum);
    return t;
}

/* Rows by which the last level is behind this kind of rows, at most: they come in groups. */
static int rows_ahead(const sf_octave *o, int kind) {
    int rows = 0;
    for (int later = kind + 1; later < SF_OCTAVE_ROWS; later++)
        rows += o->taps[later].radius + 2 * SF_BLUR_ROWS;
    return rows;
}

/* Rows that stay: as far back as the search is, MARGIN more behind the last level, and as far as it sees from
 * there, or a descriptor does. */
static int kept_for_search(const sf_octave *o, int kind) { return rows_ahead(o, kind) + 2 * MARGIN + 2; }

/* Of the levels that points are described in, 1..SF_OCTAVE_LAYERS; 0 of the others. */
static int layer_of(int kind) {
    int level = kind - SF_OCTAVE_FIRST;
    return level >= 1 && level <= SF_OCTAVE_LAYERS ? level : 0;
}

static int kept_rows(const sf_octave *o, int kind) {
    if (layer_of(kind)) return kept_for_search(o, kind) + SF_DESCRIBE_REACH;
    return kind + 1 < SF_OCTAVE_ROWS ? 2 * o->taps[kind + 1].radius + 2 * SF_BLUR_ROWS : SF_BLUR_ROWS;
}

sf_status sf_octave_create(sf_octave *o, int width, int height, double step, int is_first) {
    sf_status status = SF_OK;
    o->width = width, o->height = height, o->scanned = 1;
    for (int k = is_first ? SF_OCTAVE_INPUT : SF_OCTAVE_FIRST; k < SF_OCTAVE_ROWS && !status; k++)
        status = (layer_of(k) ? sf_band_create : sf_band_create_ring)(o->ctx, &o->rows[k], width,
                                                                      kept_rows(o, k), SF_BLUR_ROWS);
    for (int k = 0; k < SF_OCTAVE_DIFFERENCES && !status; k++)
        status = sf_band_create_ring(o->ctx, &o->differences[k], width,
                                     kept_for_search(o, SF_OCTAVE_FIRST + 1 + k), SF_BLUR_ROWS);
    if (status) return status;
    o->scratch = sf_calloc(o->ctx, sf_blur_scratch(width), sizeof *o->scratch);
    o->columns = sf_alloc(o->ctx, (size_t)width, sizeof *o->columns);
    o->describe.sums = sf_alloc(o->ctx, SF_DESCRIPTOR * SF_LANES, sizeof *o->describe.sums);
    o->describe.kernels = o->ctx->kernels;
    o->describe.width = width, o->describe.height = height, o->describe.step = step;
    o->describe.directions = o->options->directions;
    return o->scratch && o->columns && o->describe.sums ? SF_OK : SF_ERR_MEMORY;
}

void sf_octave_free(sf_octave *o) {
    for (int k = 0; k < SF_OCTAVE_ROWS; k++) sf_band_free(o->ctx, &o->rows[k]);
    for (int k = 0; k < SF_OCTAVE_DIFFERENCES; k++) sf_band_free(o->ctx, &o->differences[k]);
    for (int k = 0; k < SF_OCTAVE_LAYERS; k++) sf_free(o->ctx, o->spots[k].items);
    sf_free(o->ctx, o->scratch);
    sf_free(o->ctx, o->columns);
    sf_free(o->ctx, o->describe.sums);
}

/* ---- points ---------------------------------------------------------------------------------------------
 */

/* The differences about a pixel of layer 1..SF_OCTAVE_LAYERS. */
static sf_cube cube_at(const sf_octave *o, int layer, int y, int x) {
    sf_cube cube;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            cube.row[i][j] = sf_band_row(&o->differences[layer - 1 + i], y - 1 + j) + x;
    return cube;
}

static int moved(double offset) { return offset > NEARER ? 1 : offset < -NEARER ? -1 : 0; }

/* From pixel to pixel to where the extremum is nearest. 0: it is not within reach. */
static int settle(const sf_octave *o, int at[3], sf_extremum *e) {
    for (int i = 0;; i++) {
        sf_cube cube = cube_at(o, at[2], at[1], at[0]);
        if (!sf_localize(&cube, e)) return 0;
        int by[3] = {moved(e->offset[0]), moved(e->offset[1]), moved(e->offset[2])};
        if (!by[0] && !by[1] && !by[2]) return 1;
        if (i == MOST_MOVES) return 0;
        for (int k = 0; k < 3; k++) at[k] += by[k];
        if (at[0] < 1 || at[0] > o->width - 2 || at[1] < 1 || at[1] > o->height - 2 || at[2] < 1 ||
            at[2] > SF_OCTAVE_LAYERS)
            return 0;
    }
}

static int is_masked(const sf_octave *o, const sf_spot *spot) {
    const sf_photo *p = o->picture;
    if (!p->mask) return 0;
    int x = (int)(spot->x * o->describe.step + 0.5), y = (int)(spot->y * o->describe.step + 0.5);
    x = x < 0 ? 0 : x < p->width ? x : p->width - 1;
    y = y < 0 ? 0 : y < p->height ? y : p->height - 1;
    return !p->mask[(size_t)y * p->stride + (size_t)x];
}

static sf_status take_extremum(sf_octave *o, int layer, int y, int x) {
    static const double scales[SF_OCTAVE_LAYERS] = {2.01587367983111, 2.53984168314119,
                                                    3.2}; /* 1.6 2^(l/3) */
    double edge = o->options->edge;
    sf_extremum e;
    int at[3] = {x, y, layer};
    if (!settle(o, at, &e)) return SF_OK;
    if (!(fabs(e.value) >= o->options->contrast)) return SF_OK;
    if (!(e.edge > 0 && e.edge < (edge + 1) * (edge + 1) / edge)) return SF_OK;
    double scale = scales[at[2] - 1] * sf_plain_exp(e.offset[2] * 0.23104906018664842); /* ln 2 / 3 */
    sf_spot spot = {(float)(at[0] + e.offset[0]), (float)(at[1] + e.offset[1]), (float)scale,
                    (float)fabs(e.value)};
    return is_masked(o, &spot) ? SF_OK : sf_spots_add(o->ctx, &o->spots[at[2] - 1], &spot);
}

static sf_status scan_row(sf_octave *o, int y) {
    sf_status status = SF_OK;
    for (int layer = 1; layer <= SF_OCTAVE_LAYERS && !status; layer++) {
        sf_extrema_args args = {.first = 1,
                                .end = o->width - 1,
                                .threshold = (float)(0.8 * o->options->contrast),
                                .columns = o->columns};
        sf_cube cube = cube_at(o, layer, y, 0);
        for (int i = 0; i < 9; i++) args.rows[i / 3][i % 3] = cube.row[i / 3][i % 3];
        size_t count = o->ctx->kernels->extrema(&args);
        for (size_t i = 0; i < count && !status; i++) status = take_extremum(o, layer, y, (int)o->columns[i]);
    }
    return status;
}

/* ---- rows -----------------------------------------------------------------------------------------------
 */

/* Each second pixel of each second row. */
static void halve(const float *row, sf_octave *coarser) {
    float *half = sf_band_next(&coarser->rows[SF_OCTAVE_FIRST]);
    for (int x = 0; x < coarser->width; x++) half[x] = row[2 * x];
}

/* Makes room for the next rows; points whose rows would go are described before. */
static sf_status make_room(sf_octave *o, int kind, int count) {
    sf_band *band = &o->rows[kind];
    int layer = layer_of(kind);
    sf_status status = SF_OK;
    if (layer && sf_band_is_full(band, count)) status = sf_describe(&o->describe, band, &o->spots[layer - 1]);
    if (!status) sf_band_make_room(band, count);
    return status;
}

/* The next rows of a kind, from those of the kind before. */
static sf_status make_rows(sf_octave *o, int kind, int count) {
    const sf_taps *taps = &o->taps[kind];
    const float *window[2 * SF_BLUR_RADIUS + SF_BLUR_ROWS];
    int y = o->rows[kind].end, level = kind - SF_OCTAVE_FIRST;
    sf_blur_args args = {.rows = window,
                         .taps = taps->weights,
                         .radius = taps->radius,
                         .width = o->width,
                         .count = count,
                         .scratch = o->scratch};
    sf_status status = make_room(o, kind, count);
    if (status) return status;
    for (int k = 0; k < 2 * taps->radius + count; k++) {
        int row = y + k - taps->radius;
        window[k] = sf_band_row(&o->rows[kind - 1], row < 0 ? 0 : row < o->height ? row : o->height - 1);
    }
    for (int k = 0; k < count; k++) {
        args.out[k] = sf_band_next(&o->rows[kind]);
        if (level >= 1) args.difference[k] = sf_band_next(&o->differences[level - 1]);
    }
    o->ctx->kernels->blur(&args);
    for (int k = 0; k < count && !status; k++) {
        if (level != SF_OCTAVE_LAYERS || !o->coarser || (y + k) % 2) continue;
        halve(args.out[k], o->coarser);
        status = sf_octave_advance(o->coarser);
    }
    return status;
}

/* How many rows of a kind the rows of the kind before allow: a group, or the last ones. */
static int next_rows(const sf_octave *o, int kind) {
    const sf_band *own = &o->rows[kind], *from = &o->rows[kind - 1];
    int left = o->height - own->end, count = left < SF_BLUR_ROWS ? left : SF_BLUR_ROWS;
    if (!from->rows) return 0;
    return from->end == o->height || own->end + count + o->taps[kind].radius <= from->end ? count : 0;
}

static int can_scan(const sf_octave *o) {
    int last = o->differences[SF_OCTAVE_DIFFERENCES - 1].end;
    return o->scanned < o->height - 1 && (last == o->height || o->scanned + MARGIN < last);
}

sf_status sf_octave_advance(sf_octave *o) {
    sf_status status = SF_OK;
    for (int done = 0; !done && !status;) {
        done = 1;
        for (int kind = SF_OCTAVE_FIRST; kind < SF_OCTAVE_ROWS && !status; kind++) {
            int count = next_rows(o, kind);
            if (!count) continue;
            status = make_rows(o, kind, count);
            done = 0;
        }
        for (; can_scan(o) && !status; done = 0) status = scan_row(o, o->scanned++);
    }
    int complete = o->scanned == o->height - 1;
    for (int layer = 1; layer <= SF_OCTAVE_LAYERS && complete && !status; layer++)
        status = sf_describe(&o->describe, &o->rows[SF_OCTAVE_FIRST + layer], &o->spots[layer - 1]);
    return status;
}
