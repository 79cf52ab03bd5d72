/* spz_write.c - Gaussians out, as .spz of version 3: one stream of gzip. */
#include "gzip.h"
#include "model_file.h"
#include "spz.h"

typedef struct spz_out {
    const sf_model *model;
    const sf_model_file_options *options;
    sf_spz_header header;
    sf_context *ctx;
    const char *path;
    sf_spz_plan plan;
    sf_spz_clips clips;
    sf_gzip_out gzip;
} spz_out;

static void put_header(spz_out *o) {
    const sf_spz_header *h = &o->header;
    uint8_t bytes[SF_SPZ_HEADER] = {'N', 'G', 'S', 'P', SF_SPZ_GZIPPED};
    for (int b = 0; b < 4; b++) bytes[8 + b] = (uint8_t)(h->count >> (8 * b));
    bytes[12] = (uint8_t)h->sh_degree;
    bytes[13] = (uint8_t)h->fraction;
    bytes[14] = h->antialiased ? 1 : 0;
    sf_gzip_put(&o->gzip, bytes, sizeof bytes);
}

static sf_status put_column(spz_out *o, sf_spz_column column) {
    sf_gaussian g = {0};
    uint8_t bytes[3 * SF_MAX_COEFFICIENTS];
    sf_gaussians fields = sf_gaussian_fields(&g);
    size_t width = (size_t)sf_spz_width(&o->header, column);
    for (size_t i = 0; i < o->header.count && width; i++) {
        int sh_bits[2];
        sf_status status = sf_model_get(o->model, o->plan.order[i], 1, &fields);
        if (status) return status;
        sf_spz_sh_bits(&o->plan, o->plan.order[i], sh_bits);
        if (o->options->spz_frame == SF_SPZ_FRAME_RUB)
            sf_gaussian_flip(&g, sf_model_sh_degree(o->model), SF_FLIP_Y | SF_FLIP_Z);
        sf_spz_encode(&o->header, column, sh_bits, &fields, bytes, &o->clips);
        sf_gzip_put(&o->gzip, bytes, width);
    }
    return SF_OK;
}

static void report(const spz_out *o, size_t clipped, const char *what) {
    if (clipped)
        sf_log(o->ctx, SF_LOG_WARNING, "%s: %zu %s, moved to the nearest that it has", o->path, clipped,
               what);
}

static sf_status put_all(spz_out *o, sf_writer *w) {
    sf_status status = sf_gzip_begin(&o->gzip, w);
    if (status) return status;
    put_header(o);
    for (sf_spz_column c = SF_SPZ_MEANS; c < SF_SPZ_COLUMNS && !status; c++) {
        if (c == SF_SPZ_SH) sf_gzip_expect_noise(&o->gzip);
        status = put_column(o, c);
    }
    sf_status ended = sf_gzip_end(&o->gzip);
    report(o, o->clips.means, "coordinates beyond what 24 bits hold");
    report(o, o->clips.scales, "log-scales beyond the format's -10..5.94");
    report(o, o->clips.colors, "values f_dc beyond the format's -3.33..3.33");
    report(o, o->clips.sh, "values of higher SH bands beyond the format's -1..0.99");
    return status ? status : ended;
}

sf_status sf_spz_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options) {
    spz_out *o = sf_calloc(w->ctx, 1, sizeof *o);
    if (!o) return SF_ERR_MEMORY;
    o->model = model;
    o->options = options;
    o->ctx = w->ctx;
    o->path = w->path;
    o->header = (sf_spz_header){.version = SF_SPZ_GZIPPED,
                                .count = (uint32_t)sf_model_count(model),
                                .sh_degree = sh_degree,
                                .antialiased = sf_model_antialiased(model)};
    sf_status status = sf_spz_make_plan(model, options->sh_bits, w->path, &o->plan);
    o->header.fraction = o->plan.fraction;
    if (!status) status = put_all(o, w);
    sf_spz_free_plan(w->ctx, &o->plan);
    sf_free(w->ctx, o);
    return status;
}
