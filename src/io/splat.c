/* splat.c - Gaussians in and out, as the .splat of previews: 32 bytes each, without higher bands of SH.
 *
 * float mean[3], float scale[3] (standard deviations), u8 rgb[3] = 255 (0.5 + C0 f_dc), u8 alpha = 255
 * opacity, u8 quat[4] = 128 + 128 q, of the unit quaternion w x y z. The file has neither a header nor an
 * end.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/bytes.h"
#include "../kernels/sh.h"
#include "model_file.h"
#include "quantise.h"

enum { ROW = SF_SPLAT_BYTES, SCALES_AT = 12, COLORS_AT = 24, ALPHA_AT = 27, QUAT_AT = 28 };

/* ---- In ---- */

static void decode(const uint8_t *row, sf_gaussian *g) {
    sf_gaussians f = sf_gaussian_fields(g);
    sf_bytes b = {.data = row, .size = ROW};
    for (int k = 0; k < 3; k++) f.means[k] = sf_bytes_f32(&b);
    for (int k = 0; k < 3; k++) f.log_scales[k] = logf(sf_bytes_f32(&b));
    for (int k = 0; k < 3; k++) f.sh[k] = (float)((row[COLORS_AT + k] / 255.0 - 0.5) / SF_SH_0);
    f.logit_opacities[0] = sf_logit_of_byte(row[ALPHA_AT]);
    for (int k = 0; k < 4; k++) f.quats[k] = (float)((row[QUAT_AT + k] - 128) / 128.0);
}

static sf_status decode_all(sf_model_builder *in, const uint8_t *data, size_t count) {
    sf_gaussian g;
    sf_status status = SF_OK;
    for (size_t i = 0; i < count && !status; i++) {
        decode(data + ROW * i, &g);
        status = sf_model_builder_put(in, &g);
    }
    return status;
}

sf_status sf_splat_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                        sf_model **model) {
    uint8_t *data;
    size_t size;
    sf_model_builder in = {0};
    sf_status status = sf_read_file(ctx, path, SF_MODEL_FILE_MOST, &data, &size);
    if (!status && size % ROW)
        status =
            sf_fail(ctx, SF_ERR_FORMAT,
                    "%s: size: %zu bytes are not a multiple of %d: truncated, or no .splat", path, size, ROW);
    if (!status) status = sf_model_builder_begin(&in, ctx, path, size / ROW, 0, options);
    if (!status) status = decode_all(&in, data, size / ROW);
    if (status)
        sf_model_builder_abandon(&in);
    else
        status = sf_model_builder_end(&in, 0, model);
    sf_free(ctx, data);
    return status;
}

/* ---- Out ---- */

typedef struct weighed {
    float weight;
    uint32_t index;
} weighed;

/* Heaviest first, then in the model's order. */
static int by_weight(const void *a, const void *b) {
    const weighed *x = a, *y = b;
    if (x->weight != y->weight) return x->weight < y->weight ? 1 : -1;
    return x->index > y->index ? 1 : -1;
}

/* Readers that stop early, and viewers before they sort, show what covers most first. */
static sf_status weigh(const sf_model *model, weighed *list) {
    for (size_t i = 0; i < sf_model_count(model); i++) {
        float log_scales[3], logit;
        const sf_gaussians f = {.log_scales = log_scales, .logit_opacities = &logit};
        sf_status status = sf_model_get(model, i, 1, &f);
        if (status) return status;
        list[i].index = (uint32_t)i;
        list[i].weight =
            log_scales[0] + log_scales[1] + log_scales[2] + logf((float)sf_sigmoid((double)logit));
    }
    qsort(list, sf_model_count(model), sizeof *list, by_weight);
    return SF_OK;
}

static void put_float(uint8_t *to, float value) {
    uint32_t u;
    memcpy(&u, &value, sizeof u);
    for (int b = 0; b < 4; b++) to[b] = (uint8_t)(u >> (8 * b));
}

static void encode(sf_gaussian *g, uint8_t row[ROW]) {
    sf_gaussians f = sf_gaussian_fields(g);
    float unit[4];
    sf_unit_quat(f.quats, unit);
    for (int k = 0; k < 3; k++) {
        put_float(row + 4 * k, f.means[k]);
        put_float(row + SCALES_AT + 4 * k, expf(f.log_scales[k]));
        row[COLORS_AT + k] = sf_byte_of(255 * (0.5 + SF_SH_0 * (double)f.sh[k]), NULL);
    }
    row[ALPHA_AT] = sf_byte_of(255 * sf_sigmoid((double)f.logit_opacities[0]), NULL);
    for (int k = 0; k < 4; k++) row[QUAT_AT + k] = sf_byte_of(128 + 128 * (double)unit[k], NULL);
}

/* What becomes of a Gaussian and its record. */
typedef void (*row_fn)(void *user, sf_gaussian *g, const uint8_t row[ROW]);

static sf_status encode_all(const sf_model *model, row_fn put, void *user) {
    sf_gaussian g;
    sf_gaussians fields = sf_gaussian_fields(&g);
    uint8_t row[ROW];
    weighed *list = sf_alloc(model->ctx, sf_model_count(model) + 1, sizeof *list);
    if (!list) return SF_ERR_MEMORY;
    sf_status status = weigh(model, list);
    for (size_t i = 0; i < sf_model_count(model) && !status; i++) {
        status = sf_model_get(model, list[i].index, 1, &fields);
        if (status) break;
        encode(&g, row);
        put(user, &g, row);
    }
    sf_free(model->ctx, list);
    return status;
}

static void put_file(void *user, sf_gaussian *g, const uint8_t row[ROW]) {
    (void)g;
    sf_writer_put(user, row, ROW);
}

/* Where in memory the next record goes, and what it leaves out. */
typedef struct places {
    uint8_t *row, *sh;
    int sh_degree;
} places;

size_t sf_splat_sh_bytes(int sh_degree) { return SF_SPLAT_SH_MOST / SF_MAX_SH_DEGREE * (size_t)sh_degree; }

static uint8_t small_byte(double value) { return sf_byte_of(128 + 128 * value, NULL); }

/* The record's colour ends at 0 and 1, before the bands are added. */
static double beyond(double color) { return color > 1 ? color - 1 : fmin(color, 0); }

static void encode_sh(const float *sh, int sh_degree, uint8_t *to) {
    memset(to, small_byte(0), sf_splat_sh_bytes(sh_degree));
    for (int c = 0; c < 3; c++) *to++ = small_byte(beyond(0.5 + SF_SH_0 * (double)sh[c]));
    for (int i = 3; i < 3 * sf_coefficients(sh_degree); i++) *to++ = small_byte((double)sh[i]);
}

static void put_memory(void *user, sf_gaussian *g, const uint8_t row[ROW]) {
    places *to = user;
    memcpy(to->row, row, ROW);
    to->row += ROW;
    if (!to->sh_degree) return;
    encode_sh(sf_gaussian_fields(g).sh, to->sh_degree, to->sh);
    to->sh += sf_splat_sh_bytes(to->sh_degree);
}

sf_status sf_splat_put(sf_writer *w, const sf_model *model, int sh_degree,
                       const sf_model_file_options *options) {
    (void)options;
    if (sh_degree > 0)
        sf_log(w->ctx, SF_LOG_INFO, "%s: bands 1 to %d of the SH are left out: a .splat has none", w->path,
               sh_degree);
    return encode_all(model, put_file, w);
}

sf_status sf_splat_encode(const sf_model *model, uint8_t *data, int sh_degree, uint8_t *sh) {
    places to = {data, sh, sh_degree};
    return encode_all(model, put_memory, &to);
}
