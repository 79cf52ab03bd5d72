/* sog_write.c - Gaussians out, as PlayCanvas's SOG of version 2: meta.json and lossless pictures of WebP in a
 * .zip, a texel a Gaussian, as splat-transform 3.7.0 reads and writes them.
 *
 * Values are rounded to the nearest of what the format has: the means' logarithms to 16 bits, rotations to 8
 * bits of the three smaller components, scales and colours to 256 levels, opacities to 8 bits. The bands of
 * the SH become those of the nearest vectors of a palette.
 */
#include "model_file.h"

#ifdef SF_HAVE_LIBWEBP

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <webp/encode.h>

#include "../scene/curve.h"
#include "codebook.h"
#include "quantise.h"
#include "zip_write.h"

enum {
    SIDE_MOST = WEBP_MAX_DIMENSION,
    PALETTE_ROW = 64, /* centroids in a row of the picture of them */
    PALETTE_LEAST = 1024,
    PALETTE_MOST = 1 << 16,
    DROPPED = 252 /* alpha of a rotation: this and the number of the greatest component */
};

typedef struct sog_out {
    sf_context *ctx;
    const sf_model *model;
    sf_zip_writer zip;
    size_t count, coefficients; /* of the bands above 0 */
    int sh_degree, width, height;
    uint32_t *order; /* [count], by texel */
    uint8_t *texels; /* [height][width][4], of the picture being made */
    float *values;   /* [count][4], of the field at hand */
    json_t *meta;
} sog_out;

static sf_status no_memory(const sog_out *o) {
    return sf_fail(o->ctx, SF_ERR_MEMORY, "%s: not written: out of memory", o->zip.w->path);
}

/* ---- Pictures ---- */

static int encode(const uint8_t *rgba, int width, int height, WebPMemoryWriter *to) {
    WebPConfig config;
    WebPPicture picture;
    if (!WebPConfigInit(&config) || !WebPPictureInit(&picture)) return 0;
    config.lossless = 1;
    config.exact = 1; /* where alpha, an opacity, is 0 the colours count too */
    picture.use_argb = 1;
    picture.width = width;
    picture.height = height;
    picture.writer = WebPMemoryWrite;
    picture.custom_ptr = to;
    int well = WebPPictureImportRGBA(&picture, rgba, 4 * width) && WebPEncode(&config, &picture);
    WebPPictureFree(&picture);
    return well;
}

static sf_status put_picture(sog_out *o, const char *name, const uint8_t *rgba, int width, int height) {
    WebPMemoryWriter packed;
    WebPMemoryWriterInit(&packed);
    sf_status status = encode(rgba, width, height, &packed) ? SF_OK : no_memory(o);
    if (!status) status = sf_zip_put(&o->zip, name, packed.mem, packed.size);
    WebPMemoryWriterClear(&packed);
    return status;
}

static sf_status put_texels(sog_out *o, const char *name) {
    return put_picture(o, name, o->texels, o->width, o->height);
}

static uint8_t *texel(const sog_out *o, size_t i) { return o->texels + 4 * i; }

/* Texels of no Gaussian are black. */
static void clear(const sog_out *o) {
    for (size_t i = 0; i < (size_t)o->width * (size_t)o->height; i++)
        memcpy(texel(o, i), (const uint8_t[]){0, 0, 0, 255}, 4);
}

static int describe(sog_out *o, const char *key, json_t *part) {
    return part && !json_object_set_new(o->meta, key, part);
}

static json_t *list_of(const float *values, size_t n) {
    json_t *list = json_array();
    for (size_t i = 0; i < n; i++) json_array_append_new(list, json_real((double)values[i]));
    return list;
}

/* ---- Means ---- */

static double log_of(float x) { return copysign(log1p(fabs((double)x)), (double)x); }

static sf_status put_means(sog_out *o) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    sf_status status = SF_OK;
    for (size_t i = 0; i < 3 * o->count; i++) {
        low[i % 3] = fmin(low[i % 3], log_of(o->values[i]));
        high[i % 3] = fmax(high[i % 3], log_of(o->values[i]));
    }
    for (int upper = 0; upper < 2 && !status; upper++) {
        clear(o);
        for (size_t i = 0; i < o->count; i++)
            for (size_t k = 0; k < 3; k++) {
                double range = high[k] - low[k], above = log_of(o->values[3 * o->order[i] + k]) - low[k];
                unsigned step = range > 0 ? (unsigned)lround(65535 * above / range) : 0;
                texel(o, i)[k] = (uint8_t)(upper ? step >> 8 : step & 255);
            }
        status = put_texels(o, upper ? "means_u.webp" : "means_l.webp");
    }
    if (!status &&
        !describe(o, "means",
                  json_pack("{s:[f,f,f], s:[f,f,f], s:[s,s]}", "mins", low[0], low[1], low[2], "maxs",
                            high[0], high[1], high[2], "files", "means_l.webp", "means_u.webp")))
        status = no_memory(o);
    return status;
}

static sf_status begin(sog_out *o) {
    const sf_gaussians means = {.means = o->values};
    sf_status status = sf_model_get(o->model, 0, o->count, &means);
    if (!status) status = sf_curve_order(o->ctx, o->values, o->count, NULL, &o->order);
    return status ? status : put_means(o);
}

/* ---- Rotations, scales, colours ---- */

static void encode_quat(const float quat[4], uint8_t to[4]) {
    float unit[4];
    int greatest = 0;
    sf_unit_quat(quat, unit);
    for (int k = 1; k < 4; k++)
        if (fabsf(unit[k]) > fabsf(unit[greatest])) greatest = k;
    double sign = unit[greatest] < 0 ? -1 : 1;
    for (int k = 0; k < 4; k++)
        if (k != greatest) *to++ = sf_byte_of(255 * (0.5 + sign * (double)unit[k] * sqrt(0.5)), NULL);
    *to = (uint8_t)(DROPPED + greatest);
}

static sf_status put_quats(sog_out *o) {
    const sf_gaussians quats = {.quats = o->values};
    sf_status status = sf_model_get(o->model, 0, o->count, &quats);
    if (status) return status;
    clear(o);
    for (size_t i = 0; i < o->count; i++) encode_quat(o->values + 4 * (size_t)o->order[i], texel(o, i));
    status = put_texels(o, "quats.webp");
    if (!status && !describe(o, "quats", json_pack("{s:[s]}", "files", "quats.webp"))) status = no_memory(o);
    return status;
}

/* Three values a Gaussian by one codebook; opacities are added to colours. */
static sf_status put_levels(sog_out *o, const char *key, const char *name, const float *logits) {
    float levels[SF_CODEBOOK];
    sf_status status = sf_codebook_make(o->ctx, o->values, 3 * o->count, levels);
    if (status) return status;
    clear(o);
    for (size_t i = 0; i < o->count; i++) {
        for (size_t k = 0; k < 3; k++)
            texel(o, i)[k] = sf_codebook_nearest(levels, o->values[3 * (size_t)o->order[i] + k]);
        if (logits) texel(o, i)[3] = sf_byte_of(255 * sf_sigmoid((double)logits[o->order[i]]), NULL);
    }
    status = put_texels(o, name);
    if (!status &&
        !describe(o, key, json_pack("{s:o, s:[s]}", "codebook", list_of(levels, SF_CODEBOOK), "files", name)))
        status = no_memory(o);
    return status;
}

static sf_status put_scales(sog_out *o) {
    const sf_gaussians scales = {.log_scales = o->values};
    sf_status status = sf_model_get(o->model, 0, o->count, &scales);
    return status ? status : put_levels(o, "scales", "scales.webp", NULL);
}

/* ---- Spherical harmonics ---- */

/* Of all Gaussians: band 0 to o->values, the bands above it to `bands` [count][coefficients][3]. */
static sf_status take_sh(sog_out *o, float *bands) {
    sf_gaussian g;
    sf_gaussians f = sf_gaussian_fields(&g);
    const sf_gaussians sh = {.sh = f.sh};
    for (size_t i = 0; i < o->count; i++) {
        sf_status status = sf_model_get(o->model, i, 1, &sh);
        if (status) return status;
        memcpy(o->values + 3 * i, f.sh, 3 * sizeof *f.sh);
        memcpy(bands + 3 * o->coefficients * i, f.sh + 3, 3 * o->coefficients * sizeof *f.sh);
    }
    return SF_OK;
}

static sf_status put_colors(sog_out *o) {
    float *logits = o->values + 3 * o->count;
    const sf_gaussians opacities = {.logit_opacities = logits};
    sf_status status = sf_model_get(o->model, 0, o->count, &opacities);
    return status ? status : put_levels(o, "sh0", "sh0.webp", logits);
}

/* As many vectors as splat-transform takes. */
static size_t palette_for(size_t count) {
    size_t most = PALETTE_LEAST;
    while (most < PALETTE_MOST && 2 * most <= count) most *= 2;
    return most;
}

static sf_status put_centroids(sog_out *o, const float *centroids, size_t made) {
    size_t dims = 3 * o->coefficients, rows = (made + PALETTE_ROW - 1) / PALETTE_ROW;
    size_t width = PALETTE_ROW * o->coefficients;
    float levels[SF_CODEBOOK];
    uint8_t *rgba = sf_calloc(o->ctx, rows * width, 4);
    sf_status status = rgba ? sf_codebook_make(o->ctx, centroids, made * dims, levels) : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < rows * width; i++) rgba[4 * i + 3] = 255;
        for (size_t i = 0; i < made * dims; i++)
            rgba[4 * (i / 3) + i % 3] = sf_codebook_nearest(levels, centroids[i]);
        status = put_picture(o, "shN_centroids.webp", rgba, (int)width, (int)rows);
    }
    if (!status && !describe(o, "shN",
                             json_pack("{s:I, s:i, s:o, s:[s,s]}", "count", (json_int_t)made, "bands",
                                       o->sh_degree, "codebook", list_of(levels, SF_CODEBOOK), "files",
                                       "shN_centroids.webp", "shN_labels.webp")))
        status = no_memory(o);
    sf_free(o->ctx, rgba);
    return status;
}

static sf_status put_labels(sog_out *o, const uint32_t *labels) {
    clear(o);
    for (size_t i = 0; i < o->count; i++)
        for (int k = 0; k < 2; k++) texel(o, i)[k] = (uint8_t)(labels[o->order[i]] >> (8 * k));
    return put_texels(o, "shN_labels.webp");
}

static sf_status put_bands(sog_out *o, const float *bands) {
    size_t dims = 3 * o->coefficients, most = palette_for(o->count), made;
    float *centroids = sf_alloc(o->ctx, most * dims, sizeof *centroids);
    uint32_t *labels = sf_alloc(o->ctx, o->count, sizeof *labels);
    sf_status status = centroids && labels ? SF_OK : SF_ERR_MEMORY;
    if (!status)
        status =
            sf_palette_make(o->ctx, &(sf_vectors){bands, o->count, dims}, most, centroids, labels, &made);
    if (!status) status = put_centroids(o, centroids, made);
    if (!status) status = put_labels(o, labels);
    sf_free(o->ctx, centroids);
    sf_free(o->ctx, labels);
    return status;
}

static sf_status put_sh(sog_out *o) {
    float *bands = sf_alloc(o->ctx, 3 * o->coefficients * o->count + 1, sizeof *bands);
    sf_status status = bands ? take_sh(o, bands) : SF_ERR_MEMORY;
    if (!status) status = put_colors(o);
    if (!status && o->sh_degree) status = put_bands(o, bands);
    sf_free(o->ctx, bands);
    return status;
}

/* ---- The whole ---- */

static sf_status put_meta(sog_out *o) {
    char *text = json_dumps(o->meta, JSON_COMPACT | JSON_REAL_PRECISION(9));
    sf_status status = text ? sf_zip_put(&o->zip, "meta.json", text, strlen(text)) : no_memory(o);
    free(text);
    return status;
}

static sf_status put_all(sog_out *o) {
    sf_status status = begin(o);
    if (!status) status = put_quats(o);
    if (!status) status = put_scales(o);
    if (!status) status = put_sh(o);
    if (!status) status = put_meta(o);
    if (!status) sf_zip_end(&o->zip);
    return status;
}

/* Nearly square, of whole blocks of 4 by 4 texels. */
static void choose_size(sog_out *o) {
    o->width = 4 * (int)ceil(sqrt((double)o->count) / 4);
    o->height = 4 * (int)ceil((double)o->count / o->width / 4);
}

sf_status sf_sog_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options) {
    sog_out o = {.ctx = w->ctx,
                 .model = model,
                 .zip = {.w = w},
                 .count = sf_model_count(model),
                 .coefficients = (size_t)sf_coefficients(sh_degree) - 1,
                 .sh_degree = sh_degree};
    (void)options;
    if (!o.count)
        return sf_fail(w->ctx, SF_ERR_ARGUMENT, "%s: not written: a .sog cannot hold 0 Gaussians", w->path);
    choose_size(&o);
    if (o.width > SIDE_MOST || o.height > SIDE_MOST)
        return sf_fail(w->ctx, SF_ERR_UNSUPPORTED,
                       "%s: not written: %zu Gaussians are more than a .sog holds", w->path, o.count);
    o.meta = json_pack("{s:i, s:{s:s}, s:I}", "version", 2, "asset", "generator", "splatfit " SF_VERSION,
                       "count", (json_int_t)o.count);
    if (o.meta && sf_model_antialiased(model)) describe(&o, "model", json_string("antialiased"));
    o.texels = sf_alloc(o.ctx, (size_t)o.width * (size_t)o.height, 4);
    o.values = sf_alloc(o.ctx, o.count, 4 * sizeof *o.values);
    sf_status status = o.meta && o.texels && o.values ? put_all(&o) : no_memory(&o);
    json_decref(o.meta);
    sf_free(o.ctx, o.texels);
    sf_free(o.ctx, o.values);
    sf_free(o.ctx, o.order);
    return status;
}

#else

sf_status sf_sog_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options) {
    (void)model, (void)sh_degree, (void)options;
    return sf_fail(w->ctx, SF_ERR_UNSUPPORTED,
                   "%s: this build writes no SOG: libwebp was not there to build with", w->path);
}

#endif
