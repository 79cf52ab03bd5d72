/* patch.c - gradients about points of a level, by direction alone and by place and direction, in plain C. */
#include "patch.h"

#include <math.h>
#include <string.h>

#include "scalar.h"

typedef struct square {
    float sample[SF_PATCH][SF_PATCH];
} square;

static float within(float x, float last) {
    x = x > 0 ? x : 0;
    return x < last ? x : last;
}

/* 1. Between the four pixels about the place. */
static float sample_at(const sf_patch_args *args, float x, float y) {
    x = within(x, (float)(args->width - 1));
    y = within(y, (float)(args->height - 1));
    float column = within(floorf(x), (float)(args->width - 2));
    float row = within(floorf(y), (float)(args->height - 2));
    const float *p = args->pixels + (size_t)row * args->stride + (size_t)column, *q = p + args->stride;
    float right = x - column, down = y - row;
    float above = p[0] + right * (p[1] - p[0]), below = q[0] + right * (q[1] - q[0]);
    return above + down * (below - above);
}

static void take_square(const sf_patch_args *args, size_t lane, square *s) {
    float a = args->a[lane], b = args->b[lane];
    for (int j = 0; j < SF_PATCH; j++) {
        float v = (float)j - 7.5f, x = args->x[lane] - v * b, y = args->y[lane] + v * a;
        for (int i = 0; i < SF_PATCH; i++) {
            float u = (float)i - 7.5f;
            s->sample[j][i] = sample_at(args, x + u * a, y + u * b);
        }
    }
}

/* 2. Of four samples, from their diagonals: along the rows, and down. */
static void gradient(const square *s, int i, int j, float *along, float *down) {
    float p = s->sample[j + 1][i + 1] - s->sample[j][i], q = s->sample[j][i + 1] - s->sample[j + 1][i];
    *along = p + q;
    *down = p - q;
}

/* 3. Its two nearest directions of 32 and its parts along them. */
static void by_direction(float along, float down, float weight, float *histogram) {
    float ax = fabsf(along), ay = fabsf(down), most = ax > ay ? ax : ay, least = ax > ay ? ay : ax;
    int k = 0, step = 1;
    for (int t = 0; t < 3; t++) k += least >= most * sf_direction_tan[t];
    float first = (most * sf_direction_sin[k + 1] - least * sf_direction_cos[k + 1]) * weight;
    float second = (least * sf_direction_cos[k] - most * sf_direction_sin[k]) * weight;
    if (!(ax >= ay)) k = 8 - k, step = -step;
    if (!(along >= 0)) k = 16 - k, step = -step;
    if (!(down >= 0)) k = 32 - k, step = -step;
    histogram[k % SF_ORIENTATIONS * SF_LANES] += first;
    histogram[(k + step) % SF_ORIENTATIONS * SF_LANES] += second;
}

void sf_orient_scalar(const sf_patch_args *args) {
    memset(args->out, 0, sizeof(float) * SF_ORIENTATIONS * SF_LANES);
    for (size_t lane = 0; lane < args->count; lane++) {
        square s;
        take_square(args, lane, &s);
        for (int j = 0; j < SF_GRADIENTS; j++)
            for (int i = 0; i < SF_GRADIENTS; i++) {
                float along, down;
                gradient(&s, i, j, &along, &down);
                by_direction(along, down, sf_near_middle[j] * sf_near_middle[i], args->out + lane);
            }
    }
}

/* 4. Its parts along the two nearest directions of 8: along an axis, and along a diagonal. */
static void parts_of(float along, float down, float parts[SF_DIRECTIONS]) {
    float ax = fabsf(along), ay = fabsf(down);
    float level = ax - ay > 0 ? ax - ay : 0, upright = ay - ax > 0 ? ay - ax : 0;
    float diagonal = (ax < ay ? ax : ay) * SF_ROOT_2;
    for (int k = 0; k < SF_DIRECTIONS; k++) parts[k] = 0;
    parts[along >= 0 ? 0 : 4] = level;
    parts[down >= 0 ? 2 : 6] = upright;
    parts[along >= 0 ? (down >= 0 ? 1 : 7) : (down >= 0 ? 3 : 5)] = diagonal;
}

/* 5. Sums of a row of gradients by columns of cells. */
static void add_row(const square *s, int j, float row[SF_CELLS][SF_DIRECTIONS]) {
    memset(row, 0, sizeof(float) * SF_CELLS * SF_DIRECTIONS);
    for (int i = 0; i < SF_GRADIENTS; i++) {
        float along, down, parts[SF_DIRECTIONS];
        gradient(s, i, j, &along, &down);
        parts_of(along, down, parts);
        for (int side = 0; side < 2; side++) {
            int cell = i / 3 - 1 + side;
            if (cell < 0 || cell >= SF_CELLS) continue;
            for (int k = 0; k < SF_DIRECTIONS; k++) row[cell][k] += sf_cell_share[i][side] * parts[k];
        }
    }
}

/* 6. The row's sums to the rows of cells. */
void sf_describe_scalar(const sf_patch_args *args) {
    memset(args->out, 0, sizeof(float) * SF_DESCRIPTOR * SF_LANES);
    for (size_t lane = 0; lane < args->count; lane++) {
        square s;
        take_square(args, lane, &s);
        for (int j = 0; j < SF_GRADIENTS; j++) {
            float row[SF_CELLS][SF_DIRECTIONS];
            add_row(&s, j, row);
            for (int side = 0; side < 2; side++) {
                int cell = j / 3 - 1 + side;
                if (cell < 0 || cell >= SF_CELLS) continue;
                float *out = args->out + (size_t)cell * SF_CELLS * SF_DIRECTIONS * SF_LANES + lane;
                for (int k = 0; k < SF_CELLS * SF_DIRECTIONS; k++)
                    out[k * SF_LANES] += sf_cell_share[j][side] * row[k / SF_DIRECTIONS][k % SF_DIRECTIONS];
            }
        }
    }
}
