/* shard.c - see shard.h. */
#include "shard.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "../cluster/cluster.h"
#include "float24.h"

/* Rows of pixels around a band that the gradient of SSIM reads. */
enum { HALO = 2 * SF_SSIM_RADIUS };

/* What a row of tiles costs beside its entries, in entries: pixels are filled and compared. */
#define ROW_WORK 16.0

enum { FIRST, LAST, WORK, COUNTS };

static size_t ranks_of(const sf_workspace *ws) { return (size_t)ws->cluster->size; }
static size_t rank_of(const sf_workspace *ws) { return (size_t)ws->cluster->rank; }

sf_status sf_shard_create(sf_workspace *ws) {
    sf_cluster *c = sf_cluster_of(ws->ctx);
    if (!c) return SF_OK;
    size_t n = (size_t)c->size;
    sf_shard *s = ws->shard = sf_calloc(ws->ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    ws->cluster = c;
    s->band_begin = sf_calloc(ws->ctx, n + 1, sizeof *s->band_begin);
    s->send = sf_calloc(ws->ctx, n, sizeof *s->send);
    s->receive = sf_calloc(ws->ctx, n, sizeof *s->receive);
    s->ranges = sf_calloc(ws->ctx, 4 * n, sizeof *s->ranges);
    return s->band_begin && s->send && s->receive && s->ranges ? SF_OK : SF_ERR_MEMORY;
}

void sf_shard_empty(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    if (!s) return;
    sf_shard_begin(ws); /* the workspace frees its own */
    void *blocks[] = {s->other.splats,    s->other.state,    s->other.in_view,
                      s->other.first_row, s->other.rows,     s->other.span_offset,
                      s->other.slot,      s->other.depth_of, s->work,
                      s->counts,          s->outgoing,       s->incoming};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ws->ctx, blocks[i]);
    s->other = (sf_drawn_arrays){0};
    s->work = NULL, s->counts = NULL, s->outgoing = s->incoming = NULL;
    s->rows_capacity = s->outgoing_capacity = s->incoming_capacity = 0;
}

void sf_shard_destroy(sf_workspace *ws) {
    if (!ws->shard) return;
    sf_shard_empty(ws);
    sf_free(ws->ctx, ws->shard->band_begin);
    sf_free(ws->ctx, ws->shard->send);
    sf_free(ws->ctx, ws->shard->receive);
    sf_free(ws->ctx, ws->shard->ranges);
    sf_free(ws->ctx, ws->shard);
    ws->shard = NULL;
    ws->cluster = NULL;
}

void sf_shard_swap(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    sf_drawn_arrays had = {.count = ws->count,
                           .capacity = ws->gaussian_capacity,
                           .splats = ws->splats,
                           .state = ws->state,
                           .in_view = ws->in_view,
                           .first_row = ws->first_row,
                           .rows = ws->rows,
                           .span_offset = ws->span_offset,
                           .slot = ws->slot,
                           .depth_of = ws->depth_of};
    const sf_drawn_arrays *o = &s->other;
    ws->count = o->count, ws->gaussian_capacity = o->capacity;
    ws->splats = o->splats, ws->state = o->state, ws->in_view = o->in_view;
    ws->first_row = o->first_row, ws->rows = o->rows;
    ws->span_offset = o->span_offset, ws->slot = o->slot, ws->depth_of = o->depth_of;
    s->other = had;
    s->drawing = !s->drawing;
}

void sf_shard_begin(sf_workspace *ws) {
    if (ws->shard && ws->shard->drawing) sf_shard_swap(ws);
}

/* Counts in each row of tiles: Gaussians that begin there, that end there, and their tiles, estimated from
 * their widths. */
static void count_rows(const sf_workspace *ws, uint32_t *counts) {
    size_t rows = (size_t)ws->eye.tiles_y;
    memset(counts, 0, COUNTS * rows * sizeof *counts);
    for (size_t i = 0; i < ws->count; i++) {
        if (!ws->rows[i]) continue;
        size_t first = ws->first_row[i], end = first + ws->rows[i];
        uint32_t tiles =
            1 + (uint32_t)fminf(ws->splats[i].half_width / (SF_TILE / 2), (float)ws->eye.tiles_x);
        counts[FIRST * rows + first]++;
        counts[LAST * rows + end - 1]++;
        for (size_t row = first; row < end; row++) counts[WORK * rows + row] += tiles;
    }
}

/* Bands of about the same work: the same on all ranks. */
static void choose_bands(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    size_t rows = (size_t)ws->eye.tiles_y, n = ranks_of(ws), row = 0;
    double all = 0, sum = 0;
    for (size_t y = 0; y < rows; y++) {
        s->work[y] = ROW_WORK * ws->eye.tiles_x;
        for (size_t r = 0; r < n; r++) s->work[y] += s->counts[(COUNTS * r + WORK) * rows + y];
        all += s->work[y];
    }
    for (size_t r = 0; r < n; r++) {
        s->band_begin[r] = (uint32_t)row;
        double until = all * (double)(r + 1) / (double)n;
        while (row < rows && (sum + s->work[row] / 2 <= until || r + 1 == n)) sum += s->work[row++];
    }
    s->band_begin[n] = (uint32_t)rows;
}

/* Gaussians of `counts` that touch a band: those that begin before its end, but not those that end before its
 * beginning. */
static size_t touching(const uint32_t *counts, size_t rows, size_t begin, size_t end) {
    size_t n = 0;
    if (begin == end) return 0;
    for (size_t y = 0; y < end; y++) n += counts[FIRST * rows + y];
    for (size_t y = 0; y < begin; y++) n -= counts[LAST * rows + y];
    return n;
}

/* What is sent of a Gaussian: the rest of its splat follows from it. Mean and depth are sent exactly: in a
 * wide picture, 2^-16 of a position is a large part of a small Gaussian, and so Gaussians have the order by
 * depth that one rank gives them. Behind those of a message stand the rows of tiles that each has of the
 * band, a number of row_bytes: the first times the band's rows, and how many, less one.
 */
enum { L00, L01, M, LOG2_OPACITY, RGB, SHORT = RGB + SF_CHANNELS };
typedef struct packed {
    uint8_t exact[3][sizeof(float)]; /* u, v, depth */
    uint8_t rest[SHORT][SF_FLOAT24_BYTES];
} packed;

_Static_assert(sizeof(packed) == SF_SHARD_SENT, "README.md of src/cluster counts the bytes");

static size_t row_bytes(size_t band_rows) { return band_rows <= 16 ? 1 : band_rows <= 256 ? 2 : 4; }

static size_t rows_of(const sf_shard *s, size_t rank) {
    return s->band_begin[rank + 1] - s->band_begin[rank];
}

static size_t sent_bytes(const sf_shard *s, size_t rank) {
    return sizeof(packed) + row_bytes(rows_of(s, rank));
}

static packed packed_of(const sf_splat *s) {
    const float exact[] = {s->u, s->v, s->depth};
    const float rest[SHORT] = {s->l00, s->l01, s->m, s->log2_opacity, s->rgb[0], s->rgb[1], s->rgb[2]};
    packed p;
    memcpy(p.exact, exact, sizeof p.exact);
    for (int k = 0; k < SHORT; k++) sf_put_float24(rest[k], p.rest[k]);
    return p;
}

/* The least bytes of a number, in the order of any machine. */
static void put_number(char *to, size_t number, size_t bytes) {
    for (size_t k = 0; k < bytes; k++) to[k] = (char)(number >> 8 * k & 255);
}

static size_t number_of(const char *from, size_t bytes) {
    size_t number = 0;
    for (size_t k = 0; k < bytes; k++) number |= (size_t)(unsigned char)from[k] << 8 * k;
    return number;
}

/* The covariance of M.1 from its whitening factors: c = (w / m)^2, det = c (w / l00)^2, b / c = -l01 / l00.
 * Sums of squares alone, which cannot cancel: right to some units in the last place. */
static sf_splat splat_of(const packed *p) {
    const float w = (float)SF_WHITEN;
    float exact[3], rest[SHORT];
    memcpy(exact, p->exact, sizeof exact);
    for (int k = 0; k < SHORT; k++) rest[k] = sf_float24(p->rest[k]);
    sf_splat s = {.u = exact[0], .v = exact[1], .depth = exact[2]};
    s.l00 = rest[L00], s.l01 = rest[L01], s.m = rest[M];
    float r2 = fmaxf((float)(((double)rest[LOG2_OPACITY] + SF_LOG2_255) * SF_WHITEN_UNDO), 0);
    float inv = 1 / s.l00, narrow = w * inv, high = w / s.m, slope = -s.l01 * inv, tilt = slope * high;
    float a = narrow * narrow + tilt * tilt, r = sqrtf(r2), root_a = sqrtf(a), ratio = s.m * inv;
    s.log2_opacity = rest[LOG2_OPACITY];
    memcpy(s.rgb, rest + RGB, sizeof s.rgb);
    s.slope = slope;
    s.reach = r2 * narrow * narrow;
    s.squeeze = ratio * ratio;
    s.lean = tilt * high * r / root_a;
    s.half_width = r * root_a;
    s.half_height = r * high;
    return s;
}

/* The message for each band, one behind the other. */
static void pack(const sf_workspace *ws, char *outgoing) {
    const sf_shard *s = ws->shard;
    size_t n = ranks_of(ws), *done = s->ranges, *at = done + n;
    for (size_t r = 0, sum = 0; r < n; sum += s->send[r] * sent_bytes(s, r), r++) done[r] = 0, at[r] = sum;
    for (size_t i = 0; i < ws->count; i++) {
        if (!ws->rows[i]) continue;
        size_t first = ws->first_row[i], last = first + ws->rows[i];
        packed p = packed_of(&ws->splats[i]);
        SF_FOR_BANDS(ws, s, n, i, r, begin, end) {
            size_t from = first > begin ? first - begin : 0, until = (last < end ? last : end) - begin;
            size_t bytes = row_bytes(end - begin);
            char *message = outgoing + at[r];
            memcpy(message + done[r] * sizeof p, &p, sizeof p);
            put_number(message + s->send[r] * sizeof p + done[r] * bytes,
                       from * (end - begin) + until - from - 1, bytes);
            done[r]++;
        }
    }
}

static size_t sum_of(const size_t *counts, size_t n) {
    size_t sum = 0;
    for (size_t r = 0; r < n; r++) sum += counts[r];
    return sum;
}

/* What this rank should send for a step (src/cluster/README.md), but for the sums: a Gaussian touches one
 * band, and one more for each boundary between bands in it, which may be at any row of tiles. A bit comes
 * back of it, and those sums that are not zero, which sf_shard_return counts. Near depths are floats, 8 KB of
 * them. */
static double designed_bytes(const sf_workspace *ws) {
    const double near_depths = 8192, halo = 4.0 * SF_CHANNELS * HALO;
    double n = (double)ranks_of(ws), tiles_y = (double)ws->eye.tiles_y, seen = 0, rows = 0;
    for (size_t i = 0; i < ws->count; i++) seen += ws->rows[i] > 0, rows += ws->rows[i];
    double touched = seen + (n - 1) * (rows - seen) / fmax(tiles_y - 1, 1), bytes = 0;
    for (size_t r = 0; r < ranks_of(ws); r++) bytes += (double)sent_bytes(ws->shard, r) / n;
    return (n - 1) / n * (touched * (bytes + 1.0 / 8) + near_depths) +
           (n - 1) * COUNTS * sizeof(uint32_t) * tiles_y + 2 * (n - 1) / n * halo * (double)ws->stride;
}

static sf_status counts_room(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    size_t rows = (size_t)ws->eye.tiles_y;
    const sf_array arrays[] = {{&s->work, sizeof *s->work},
                               {&s->counts, COUNTS * (ranks_of(ws) + 1) * sizeof *s->counts}};
    return sf_grow_together(ws->ctx, arrays, 2, &s->rows_capacity, rows);
}

static sf_status drawn_room(sf_workspace *ws, sf_drawn_arrays *d, size_t count) {
    const sf_array arrays[] = {
        {&d->splats, sizeof *d->splats},           {&d->state, sizeof *d->state},
        {&d->first_row, sizeof *d->first_row},     {&d->rows, sizeof *d->rows},
        {&d->span_offset, sizeof *d->span_offset}, {&d->slot, sizeof *d->slot},
        {&d->depth_of, sizeof *d->depth_of},       {&d->in_view, sizeof *d->in_view},
    };
    size_t need = (count + SF_LANES - 1) / SF_LANES * SF_LANES + 1;
    return sf_grow_together(ws->ctx, arrays, sizeof arrays / sizeof *arrays, &d->capacity, need);
}

/* A message, and where its Gaussians begin. */
typedef struct unpack_job {
    const char *message;
    size_t count, first, first_row, band_rows;
    const sf_drawn_arrays *drawn;
} unpack_job;

enum { GATHER = 1024 /* Gaussians a task */ };

static void unpack_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const unpack_job *job = job_pointer;
    const char *rows = job->message + job->count * sizeof(packed);
    size_t bytes = row_bytes(job->band_rows);
    for (size_t k = task * GATHER; k < (task + 1) * GATHER && k < job->count; k++) {
        size_t i = job->first + k, number = number_of(rows + k * bytes, bytes);
        packed p;
        memcpy(&p, job->message + k * sizeof p, sizeof p);
        job->drawn->splats[i] = splat_of(&p);
        job->drawn->first_row[i] = (uint16_t)(job->first_row + number / job->band_rows);
        job->drawn->rows[i] = (uint16_t)(1 + number % job->band_rows);
    }
}

/* Ranks in their order, and within a rank the order of its model: ties in depth go by it. */
static void unpack(const sf_workspace *ws, const char *incoming, size_t count, sf_drawn_arrays *d) {
    const sf_shard *s = ws->shard;
    size_t me = rank_of(ws);
    unpack_job job = {
        .message = incoming, .first_row = s->band_begin[me], .band_rows = rows_of(s, me), .drawn = d};
    for (size_t r = 0; r < ranks_of(ws); r++) {
        job.count = s->receive[r];
        sf_pool_run(ws->ctx->pool, (job.count + GATHER - 1) / GATHER, unpack_task, &job);
        job.first += job.count, job.message += job.count * sent_bytes(s, me);
    }
    for (size_t i = count; i < (count + SF_LANES - 1) / SF_LANES * SF_LANES; i++) {
        d->splats[i] = (sf_splat){0};
        d->first_row[i] = d->rows[i] = 0;
    }
    memset(d->state, SF_SEEN, count);
    memset(d->in_view, 1, count / (SF_PROJECT_BLOCKS * SF_LANES) + 1);
    d->count = count;
}

/* Sends the messages; what came is in `incoming`, by rank. */
static sf_status exchange(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    size_t n = ranks_of(ws), *send = s->ranges, *receive = send + n, me = rank_of(ws);
    size_t sent = 0, received = sum_of(s->receive, n) * sent_bytes(s, me);
    for (size_t r = 0; r < n; r++) sent += s->send[r] * sent_bytes(s, r);
    sf_status status = sf_grow(ws->ctx, &s->outgoing, &s->outgoing_capacity, 0, sent + 1, 1);
    if (!status) status = sf_grow(ws->ctx, &s->incoming, &s->incoming_capacity, 0, received + 1, 1);
    if (status) return status;
    pack(ws, s->outgoing);
    for (size_t r = 0; r < n; r++)
        send[r] = s->send[r] * sent_bytes(s, r), receive[r] = s->receive[r] * sent_bytes(s, me);
    sf_cluster_exchange(ws->cluster, 1, s->outgoing, send, s->incoming, receive);
    return SF_OK;
}

sf_status sf_shard_send(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    if (!s) return SF_OK;
    size_t n = ranks_of(ws), rows = (size_t)ws->eye.tiles_y, me = rank_of(ws);
    sf_status status = counts_room(ws);
    if (status) return status;
    uint32_t *mine = s->counts + COUNTS * n * rows;
    count_rows(ws, mine);
    sf_cluster_gather_bytes(ws->cluster, mine, COUNTS * rows * sizeof *mine, s->counts);
    choose_bands(ws);
    if (ws->band_only) ws->cluster->designed += designed_bytes(ws);
    for (size_t r = 0; r < n; r++) {
        s->send[r] = touching(mine, rows, s->band_begin[r], s->band_begin[r + 1]);
        s->receive[r] =
            touching(s->counts + COUNTS * r * rows, rows, s->band_begin[me], s->band_begin[me + 1]);
    }
    size_t received = sum_of(s->receive, n);
    status = drawn_room(ws, &s->other, received);
    if (!status) status = exchange(ws);
    if (status) return status;
    unpack(ws, s->incoming, received, &s->other);
    sf_shard_swap(ws);
    return SF_OK;
}

/* Rows of pixels of a rank's band. */
static void rows_of_band(const sf_workspace *ws, size_t rank, size_t *first, size_t *end) {
    size_t height = (size_t)ws->eye.height;
    *first = SF_TILE * (size_t)ws->shard->band_begin[rank];
    *end = SF_TILE * (size_t)ws->shard->band_begin[rank + 1];
    if (*first > height) *first = height;
    if (*end > height) *end = height;
}

void sf_shard_picture(sf_workspace *ws, int with_depth) {
    sf_shard *s = ws->shard;
    if (!s) return;
    size_t n = ranks_of(ws), *begin = s->ranges, *end = begin + n, *wanted = end + n;
    for (size_t r = 0; r < n; r++) {
        size_t height = (size_t)ws->eye.height;
        rows_of_band(ws, r, &begin[r], &end[r]);
        wanted[2 * r] = 0, wanted[2 * r + 1] = height;
        if (!ws->band_only) continue;
        wanted[2 * r] = begin[r] > HALO ? begin[r] - HALO : 0;
        wanted[2 * r + 1] = end[r] + HALO < height ? end[r] + HALO : height;
        if (begin[r] == end[r]) wanted[2 * r + 1] = wanted[2 * r];
    }
    const sf_shared_ranges ranges = {ws->stride * sizeof(float), begin, end, wanted};
    char *const planes[] = {(char *)ws->rgb[0], (char *)ws->rgb[1], (char *)ws->rgb[2],
                            (char *)ws->transmittance, (char *)ws->depth};
    sf_cluster_share(ws->cluster, &ranges, planes, ws->band_only ? SF_CHANNELS : with_depth ? 5 : 4);
}

void sf_shard_rows(const sf_workspace *ws, size_t *first, size_t *end) {
    *first = 0, *end = (size_t)ws->eye.height;
    if (ws->shard && ws->band_only) rows_of_band(ws, rank_of(ws), first, end);
}

void sf_shard_loss_rows(const sf_workspace *ws, size_t *first, size_t *end) {
    size_t height = (size_t)ws->eye.height;
    sf_shard_rows(ws, first, end);
    if (!ws->shard || !ws->band_only || *first == *end) return;
    *first = *first > HALO ? *first - HALO : 0;
    *end = *end + HALO < height ? *end + HALO : height;
}

void sf_shard_tile_rows(const sf_workspace *ws, size_t *first, size_t *end) {
    *first = 0, *end = (size_t)ws->eye.tiles_y;
    if (!ws->shard) return;
    *first = ws->shard->band_begin[rank_of(ws)];
    *end = ws->shard->band_begin[rank_of(ws) + 1];
}

size_t sf_shard_own(const sf_workspace *ws, const sf_splat **splats, const uint8_t **state) {
    const sf_drawn_arrays *own = ws->shard && ws->shard->drawing ? &ws->shard->other : NULL;
    *splats = own ? own->splats : ws->splats;
    *state = own ? own->state : ws->state;
    return own ? own->count : ws->count;
}

void sf_shard_sum(const sf_workspace *ws, double *values, size_t n) {
    if (ws->shard && ws->band_only) sf_cluster_sum(ws->cluster, values, n);
}
