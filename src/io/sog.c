/* sog.c - Gaussians in, from PlayCanvas's SOG: meta.json and pictures of WebP, in a .zip or a folder.
 *
 * Versions 1 and 2, as splat-transform 3.2 reads them. Both become tables of 256 values: version 2 lists
 * them, version 1 gives their ends.
 */
#include "model_file.h"
#include "quantise.h"

#if defined(SF_HAVE_LIBZIP) && defined(SF_HAVE_LIBWEBP)

#include <limits.h>
#include <string.h>
#include <webp/decode.h>
#include <zip.h>

#include "json_read.h"
#include "paths.h"
#include "zip.h"

enum {
    LEVELS = 256,
    PALETTE_ROW = 64, /* centroids in a row of the picture of them */
    PALETTE_MOST = 1 << 16,
    PACKED_A_BYTE = 1032, /* the most that deflate packs into one */
    COUNT_FREE = 1 << 16, /* Gaussians that any file may have, */
    COUNT_RATIO = 200     /* or this many times its bytes */
};

static const uint64_t META_MOST = 1 << 24, PICTURE_MOST = (uint64_t)1 << 31;

typedef enum sog_picture {
    MEANS_LOW,
    MEANS_HIGH,
    SCALES,
    QUATS,
    SH0,
    CENTROIDS,
    LABELS,
    PICTURES
} sog_picture;

typedef struct sog {
    sf_context *ctx;
    const char *path;
    char *folder; /* NULL: `zip` is open */
    zip_t *zip;
    json_t *meta;
    int version, sh_degree, antialiased;
    size_t count, palette;
    uint64_t bytes;         /* of the pictures' files */
    double low[3], high[3]; /* of the means' logarithms */
    float scales[3][LEVELS], sh0[4][LEVELS], higher[LEVELS];
    uint8_t *rgba[PICTURES]; /* of WebPDecodeRGBA */
} sog;

static sf_status refuse(const sog *s, const char *field, const char *why) {
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: %s", s->path, field, why);
}

/* ---- Files ---- */

static sf_status read_zipped(const sog *s, const char *name, uint64_t most, uint8_t **data, size_t *size) {
    zip_stat_t st;
    const zip_uint64_t needed = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE;
    if (zip_stat(s->zip, name, 0, &st) || (st.valid & needed) != needed)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is not in the archive", s->path, name);
    if (st.size > most || st.comp_size > most || st.size > st.comp_size * PACKED_A_BYTE + PACKED_A_BYTE)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: size: %llu is not possible", s->path, name,
                       (unsigned long long)st.size);
    zip_file_t *file = zip_fopen(s->zip, name, 0);
    *size = (size_t)st.size;
    *data = file ? sf_alloc(s->ctx, *size + 1, 1) : NULL;
    sf_status status = SF_OK;
    if (file && !*data)
        status = SF_ERR_MEMORY;
    else if (!file || zip_fread(file, *data, st.size) != (zip_int64_t)st.size)
        status = sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is damaged", s->path, name);
    if (file) zip_fclose(file);
    return status;
}

static sf_status read_part(const sog *s, const char *name, uint64_t most, uint8_t **data, size_t *size) {
    *data = NULL;
    if (!sf_name_stays_inside(name)) return refuse(s, "files", "a name leads out of the folder");
    if (s->zip) return read_zipped(s, name, most, data, size);
    char *path = sf_path_join(s->ctx, s->folder, name);
    sf_status status = path ? sf_read_file(s->ctx, path, most, data, size) : SF_ERR_MEMORY;
    sf_free(s->ctx, path);
    return status;
}

static sf_status open_parts(sog *s) {
    int error = 0;
    if (!sf_zip_is(s->path)) {
        s->folder = sf_path_folder(s->ctx, s->path);
        if (!s->folder) return SF_ERR_MEMORY;
        return sf_json_read(s->ctx, s->path, META_MOST, &s->meta);
    }
    uint8_t *text = NULL;
    size_t size;
    json_error_t fault;
    s->zip = zip_open(s->path, ZIP_RDONLY, &error);
    if (!s->zip) return refuse(s, "zip", "is damaged");
    sf_status status = read_part(s, "meta.json", META_MOST, &text, &size);
    if (!status) s->meta = json_loadb((const char *)text, size, 0, &fault);
    sf_free(s->ctx, text);
    if (status || s->meta) return status;
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: meta.json: line %d: JSON: %s", s->path, fault.line,
                   fault.text);
}

/* ---- meta.json ---- */

static const json_t *field(const sog *s, const char *part, const char *key) {
    return json_object_get(json_object_get(s->meta, part), key);
}

static sf_status numbers(const sog *s, const char *part, const char *key, size_t n, double *to) {
    const json_t *list = field(s, part, key);
    for (size_t i = 0; i < n; i++) {
        const json_t *number = n == 1 && json_is_number(list) ? list : json_array_get(list, i);
        to[i] = json_number_value(number);
        if (!json_is_number(number) || !isfinite(to[i]))
            return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: %s: is not %zu finite numbers", s->path, part, key,
                           n);
    }
    return SF_OK;
}

/* Tables of n channels: one codebook for all, or each between its ends. Short codebooks end with 0. */
static sf_status read_tables(const sog *s, const char *part, size_t n, float (*tables)[LEVELS]) {
    double low[4], high[4], book[LEVELS] = {0};
    size_t listed = json_array_size(field(s, part, "codebook"));
    sf_status status = SF_OK;
    if (s->version == 2 && (!listed || listed > LEVELS))
        return refuse(s, part, "codebook: is not 1 to 256 numbers");
    if (s->version == 2) {
        status = numbers(s, part, "codebook", listed, book);
    } else {
        status = numbers(s, part, "mins", n, low);
        if (!status) status = numbers(s, part, "maxs", n, high);
    }
    for (size_t c = 0; c < n && !status; c++)
        for (int i = 0; i < LEVELS; i++)
            tables[c][i] = (float)(s->version == 2 ? book[i] : low[c] + (high[c] - low[c]) * i / 255);
    return status;
}

static sf_status read_count(sog *s) {
    const json_t *version = json_object_get(s->meta, "version");
    s->version = version ? (int)json_integer_value(version) : 1;
    if (s->version != 2 && version)
        return sf_fail(s->ctx, SF_ERR_UNSUPPORTED, "%s: version: %d is neither 1 nor 2", s->path, s->version);
    const json_t *count =
        s->version == 2 ? json_object_get(s->meta, "count") : json_array_get(field(s, "means", "shape"), 0);
    json_int_t n = json_integer_value(count);
    if (!json_is_integer(count) || n < 1 || n > INT32_MAX - SF_LANES)
        return refuse(s, "count", "is not a number of Gaussians");
    s->count = (size_t)n;
    const char *model = json_string_value(json_object_get(s->meta, "model"));
    s->antialiased = model && !strcmp(model, "antialiased");
    return SF_OK;
}

static sf_status read_meta(sog *s) {
    sf_status status = read_count(s);
    if (!status) status = numbers(s, "means", "mins", 3, s->low);
    if (!status) status = numbers(s, "means", "maxs", 3, s->high);
    if (!status) status = read_tables(s, "scales", 3, s->scales);
    if (!status) status = read_tables(s, "sh0", s->version == 2 ? 3 : 4, s->sh0);
    for (int i = 0; i < LEVELS && s->version == 2; i++) s->sh0[3][i] = sf_logit_of_byte((uint8_t)i);
    if (!status && json_object_get(s->meta, "shN")) status = read_tables(s, "shN", 1, &s->higher);
    return status;
}

/* ---- Pictures ---- */

static const struct {
    const char *part;
    size_t file;
} sources[PICTURES] = {{"means", 0}, {"means", 1}, {"scales", 0}, {"quats", 0},
                       {"sh0", 0},   {"shN", 0},   {"shN", 1}};

static sf_status check_centroids(sog *s, int width, int height) {
    s->sh_degree = width == PALETTE_ROW * 3    ? 1
                   : width == PALETTE_ROW * 8  ? 2
                   : width == PALETTE_ROW * 15 ? 3
                                               : 0;
    s->palette = (size_t)height * PALETTE_ROW;
    if (s->sh_degree && s->palette <= PALETTE_MOST) return SF_OK;
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: shN: %d x %d is no picture of centroids", s->path, width,
                   height);
}

static sf_status check_texels(const sog *s, const char *name, int width, int height) {
    uint64_t texels = (uint64_t)width * (uint64_t)height;
    if (texels >= s->count && texels <= 4 * (uint64_t)s->count + COUNT_FREE) return SF_OK;
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: %d x %d does not go with %zu Gaussians", s->path, name,
                   width, height, s->count);
}

static sf_status decode_picture(sog *s, sog_picture p, const char *name, const uint8_t *data, size_t size) {
    WebPBitstreamFeatures f;
    if (WebPGetFeatures(data, size, &f) != VP8_STATUS_OK) return refuse(s, name, "is no WebP");
    sf_status status =
        p == CENTROIDS ? check_centroids(s, f.width, f.height) : check_texels(s, name, f.width, f.height);
    if (status) return status;
    s->rgba[p] = WebPDecodeRGBA(data, size, &f.width, &f.height);
    return s->rgba[p] ? SF_OK : refuse(s, name, "WebP: is damaged");
}

static sf_status read_picture(sog *s, sog_picture p) {
    const char *name = json_string_value(json_array_get(field(s, sources[p].part, "files"), sources[p].file));
    uint8_t *data;
    size_t size;
    if (!name) return refuse(s, sources[p].part, "files: names no picture");
    sf_status status = read_part(s, name, PICTURE_MOST, &data, &size);
    if (!status && p == MEANS_LOW && s->count > COUNT_FREE && s->count / COUNT_RATIO > size)
        status = sf_fail(s->ctx, SF_ERR_FORMAT, "%s: count: %zu Gaussians are more than %s's %zu bytes hold",
                         s->path, s->count, name, size);
    if (!status) status = decode_picture(s, p, name, data, size);
    sf_free(s->ctx, data);
    return status;
}

/* ---- Values ---- */

/* The three smaller components, of 1/sqrt(2) at most; the greatest is the one that is missing. */
static void decode_quat(const uint8_t *rgba, float quat[4]) {
    const double root = sqrt(0.5);
    int greatest = rgba[3] >= 252 ? rgba[3] - 252 : 0, from = 0;
    double rest = 1;
    for (int k = 0; k < 4; k++) {
        if (k == greatest) continue;
        double value = rgba[3] >= 252 ? (rgba[from++] / 255.0 * 2 - 1) * root : 0;
        rest -= value * value;
        quat[k] = (float)value;
    }
    quat[greatest] = (float)sqrt(fmax(rest, 0));
}

static void decode_sh(const sog *s, size_t i, float *sh) {
    if (!s->sh_degree) return;
    const uint8_t *label = s->rgba[LABELS] + 4 * i;
    size_t palette = (size_t)label[0] | (size_t)label[1] << 8, n = (size_t)sf_coefficients(s->sh_degree) - 1;
    for (size_t k = 0; k < n; k++)
        for (size_t c = 0; c < 3; c++)
            sh[3 * (k + 1) + c] =
                palette < s->palette ? s->higher[s->rgba[CENTROIDS][4 * (palette * n + k) + c]] : 0;
}

static void decode(const sog *s, size_t i, sf_gaussian *g) {
    sf_gaussians f = sf_gaussian_fields(g);
    for (size_t k = 0; k < 3; k++) {
        int bits = s->rgba[MEANS_LOW][4 * i + k] | s->rgba[MEANS_HIGH][4 * i + k] << 8;
        double log = s->low[k] + (s->high[k] - s->low[k]) * bits / 65535;
        f.means[k] = (float)copysign(expm1(fabs(log)), log);
        f.log_scales[k] = s->scales[k][s->rgba[SCALES][4 * i + k]];
        f.sh[k] = s->sh0[k][s->rgba[SH0][4 * i + k]];
    }
    f.logit_opacities[0] = s->sh0[3][s->rgba[SH0][4 * i + 3]];
    decode_quat(s->rgba[QUATS] + 4 * i, f.quats);
    decode_sh(s, i, f.sh);
}

static sf_status decode_all(const sog *s, const sf_model_file_options *options, sf_model **model) {
    sf_model_builder in;
    sf_gaussian g;
    sf_status status = sf_model_builder_begin(&in, s->ctx, s->path, s->count,
                                              sf_kept_degree(s->sh_degree, options), options);
    for (size_t i = 0; i < s->count && !status; i++) {
        decode(s, i, &g);
        status = sf_model_builder_put(&in, &g);
    }
    if (status)
        sf_model_builder_abandon(&in);
    else
        status = sf_model_builder_end(&in, s->antialiased, model);
    return status;
}

sf_status sf_sog_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model) {
    sog *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    s->path = path;
    sf_status status = open_parts(s);
    if (!status) status = read_meta(s);
    int pictures = json_object_get(s->meta, "shN") ? PICTURES : CENTROIDS;
    for (int p = 0; p < pictures && !status; p++) status = read_picture(s, (sog_picture)p);
    if (!status) status = decode_all(s, options, model);
    for (int p = 0; p < PICTURES; p++) WebPFree(s->rgba[p]);
    if (s->zip) zip_discard(s->zip);
    json_decref(s->meta);
    sf_free(ctx, s->folder);
    sf_free(ctx, s);
    return status;
}

#else

sf_status sf_sog_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model) {
    (void)options;
    *model = NULL;
    return sf_fail(ctx, SF_ERR_UNSUPPORTED,
                   "%s: this build reads no SOG: libwebp and libzip were not both there to build with", path);
}

#endif
