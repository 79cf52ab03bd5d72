/* model_file.c - models in and out: which format, and what all of them share. */
#include "model_file.h"

#include <math.h>
#include <string.h>
#include <strings.h>

#include "spz.h"

typedef sf_status (*load_fn)(sf_context *ctx, const char *path, const sf_model_file_options *options,
                             sf_model **model);
typedef sf_status (*put_fn)(sf_writer *w, const sf_model *model, int sh_degree,
                            const sf_model_file_options *options);

static const struct {
    const char *extension;
    load_fn load;
    put_fn put;
    int states_origin; /* a file says to which origin its coordinates are relative */
} formats[] = {
    [SF_MODEL_PLY] = {".ply", sf_ply_load, sf_ply_put, 1},
    [SF_MODEL_SPZ] = {".spz", sf_spz_load, sf_spz_put, 0},
    [SF_MODEL_SPLAT] = {".splat", sf_splat_load, sf_splat_put, 0},
    [SF_MODEL_GLTF] = {".glb", sf_gltf_load, sf_gltf_put, 1},
    [SF_MODEL_SOG] = {".sog", sf_sog_load, sf_sog_put, 0},
};

sf_model_file_options sf_model_file_options_default(void) { return (sf_model_file_options){.sh_degree = -1}; }

static sf_status check_range(sf_context *ctx, const char *name, int value, int least, int most) {
    if (value >= least && value <= most) return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %d is not in %d..%d", name, value, least, most);
}

static sf_status check_options(sf_context *ctx, const sf_model_file_options *o) {
    sf_status status = check_range(ctx, "format", (int)o->format, SF_MODEL_AUTO, SF_MODEL_SOG);
    if (!status) status = check_range(ctx, "sh_degree", o->sh_degree, -1, SF_MAX_SH_DEGREE);
    for (int i = 0; i < 2 && !status; i++) status = check_range(ctx, "sh_bits", o->sh_bits[i], 0, 8);
    if (!status && !o->sh_bits[0] != !o->sh_bits[1])
        status = sf_fail(ctx, SF_ERR_ARGUMENT, "sh_bits: %d and %d: both are 0, or none", o->sh_bits[0],
                         o->sh_bits[1]);
    if (!status) status = check_range(ctx, "world", o->world, 0, 1);
    if (!status) status = check_range(ctx, "parts", o->parts, 0, 1 << 20);
    if (!status) status = check_range(ctx, "part", o->part, 0, o->parts > 1 ? o->parts - 1 : 0);
    if (!status)
        status = check_range(ctx, "spz_frame", (int)o->spz_frame, SF_SPZ_FRAME_OWN, SF_SPZ_FRAME_RUB);
    return status;
}

int sf_kept_degree(int sh_degree, const sf_model_file_options *options) {
    return options->sh_degree >= 0 && options->sh_degree < sh_degree ? options->sh_degree : sh_degree;
}

static int has_extension(const char *path, const char *extension) {
    size_t n = strlen(path), m = strlen(extension);
    return n > m && !strcasecmp(path + n - m, extension);
}

int sf_file_degree(sf_context *ctx, const char *path, int sh_degree, const sf_model_file_options *options) {
    if (sh_degree <= SF_MAX_SH_DEGREE) return sf_kept_degree(sh_degree, options);
    sf_log(ctx, SF_LOG_WARNING, "%s: band %d of the SH is left out", path, sh_degree);
    return sf_kept_degree(SF_MAX_SH_DEGREE, options);
}

/* From the last dot of the name on; "" where it has none, as "-" and devices have not. */
static const char *ending(const char *path) {
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path, *dot = strrchr(name, '.');
    return dot && dot > name ? dot : "";
}

static sf_model_format format_to_write(const char *path) {
    for (sf_model_format f = SF_MODEL_PLY; f <= SF_MODEL_SOG; f++)
        if (has_extension(path, formats[f].extension)) return f;
    return *ending(path) ? SF_MODEL_AUTO : SF_MODEL_PLY;
}

sf_status sf_model_check_name(sf_context *ctx, const char *path) {
    if (format_to_write(path)) return SF_OK;
    return sf_fail(ctx, SF_ERR_UNSUPPORTED,
                   "%s: models are not written as %.40s: name it .ply, .spz, .splat, .glb or .sog", path,
                   ending(path));
}

/* A .splat has nothing in it that tells. What cannot be read is the .ply reader's to refuse. */
static sf_model_format format_to_read(const char *path) {
    uint8_t first[4] = {0};
    if (has_extension(path, formats[SF_MODEL_SPLAT].extension)) return SF_MODEL_SPLAT;
    size_t size = sf_read_start(path, first, sizeof first);
    if (!memcmp(first, "PK\3\4", 4) || has_extension(path, "meta.json")) return SF_MODEL_SOG;
    if (!memcmp(first, "glTF", 4) || has_extension(path, ".gltf")) return SF_MODEL_GLTF;
    if (sf_spz_begins(first, size)) return SF_MODEL_SPZ;
    return has_extension(path, formats[SF_MODEL_SPZ].extension) && memcmp(first, "ply", 3) ? SF_MODEL_SPZ
                                                                                           : SF_MODEL_PLY;
}

sf_status sf_model_load_as(sf_context *ctx, const char *path, const sf_model_file_options *options,
                           sf_model **model) {
    sf_model_file_options o = options ? *options : sf_model_file_options_default();
    *model = NULL;
    sf_status status = check_options(ctx, &o);
    if (status) return status;
    if (!o.format && has_extension(path, ".ksplat"))
        return sf_fail(
            ctx, SF_ERR_UNSUPPORTED,
            "%s: .ksplat, of GaussianSplats3D, is not read: npx @playcanvas/splat-transform IN OUT.ply "
            "makes a .ply of it",
            path);
    return formats[o.format ? o.format : format_to_read(path)].load(ctx, path, &o, model);
}

sf_status sf_model_load(sf_context *ctx, const char *path, sf_model **model) {
    return sf_model_load_as(ctx, path, NULL, model);
}

/* How far apart floats are near a value. */
static double float_step(double value) {
    float near = fabsf((float)value);
    return (double)nextafterf(near, INFINITY) - (double)near;
}

/* A copy whose means are relative to the world's 0. */
static sf_status copy_in_world(const sf_model *model, const char *path, sf_model **copy) {
    static const double zero[3];
    double step = 0;
    for (int k = 0; k < 3; k++) step = fmax(step, float_step(model->origin[k]));
    sf_status status = sf_model_copy(model, model->count, copy);
    if (status) return status;
    sf_model_set_origin(*copy, zero);
    sf_log(model->ctx, SF_LOG_WARNING,
           "%s: coordinates of the world: floats near the origin %.17g %.17g %.17g are %g apart", path,
           model->origin[0], model->origin[1], model->origin[2], step);
    return SF_OK;
}

static void warn_without_origin(const sf_model *model, const char *path) {
    sf_log(model->ctx, SF_LOG_WARNING,
           "%s: the format cannot state the origin %.17g %.17g %.17g, to which its coordinates are relative",
           path, model->origin[0], model->origin[1], model->origin[2]);
}

sf_status sf_model_file_check(sf_context *ctx, const char *path, const sf_model_file_options *options,
                              sf_model_format *format) {
    sf_status status = check_options(ctx, options);
    if (!status && !options->format) status = sf_model_check_name(ctx, path);
    *format = options->format ? options->format : format_to_write(path);
    return status;
}

static sf_status save(const sf_model *model, const char *path, sf_model_format format,
                      const sf_model_file_options *o) {
    sf_writer w;
    sf_status status = sf_writer_open(&w, model->ctx, path);
    if (status) return status;
    status = formats[format].put(&w, model, sf_kept_degree(sf_model_sh_degree(model), o), o);
    if (!status) return sf_writer_commit(&w);
    sf_writer_abandon(&w);
    return status;
}

sf_status sf_model_save_as(const sf_model *model, const char *path, const sf_model_file_options *options) {
    sf_model_file_options o = options ? *options : sf_model_file_options_default();
    sf_model *copy = NULL;
    sf_model_format format;
    sf_status status = sf_model_file_check(model->ctx, path, &o, &format);
    if (!status) status = sf_model_check(model, path);
    if (status) return status;
    if (sf_model_has_origin(model) && o.world)
        status = copy_in_world(model, path, &copy);
    else if (sf_model_has_origin(model) && !formats[format].states_origin)
        warn_without_origin(model, path);
    if (!status && copy) status = sf_model_check(copy, path); /* an origin beyond floats */
    if (!status) status = save(copy ? copy : model, path, format, &o);
    sf_model_destroy(&copy);
    return status;
}

sf_status sf_model_save(const sf_model *model, const char *path) {
    return sf_model_save_as(model, path, NULL);
}
