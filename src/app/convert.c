/* convert.c - splatfit convert: a model from one format to another, and what that costs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "compare.h"
#include "model_transform.h"

static const arg_option own_options[] = {
    {"sh-degree", 0, "N", "leave out the SH bands above N, 0..3"},
    {"sh-bits", 0, "A,B",
     "bits of each SH value in a .spz: in band 1, in the bands above, 1..8; default: more bits for Gaussians "
     "that cover much of a picture"},
    {"json", 0, "FILE", "also write bytes, ratio and the comparison as JSON"},
    {0},
};

/* "A,B", both 1..8. */
static int read_bits(const args *a, int bits[2]) {
    const char *text = args_value(a, "sh-bits");
    if (!text) return 0;
    for (int i = 0; i < 2; i++) {
        char *end;
        long value = strtol(text, &end, 10);
        if (end == text || *end != (i ? 0 : ',') || value < 1 || value > 8) {
            args_error(a->command, "--sh-bits: \"%s\" is not two numbers A,B in 1..8",
                       args_value(a, "sh-bits"));
            return EXIT_USAGE;
        }
        bits[i] = (int)value;
        text = end + 1;
    }
    return 0;
}

static int read_options(const args *a, sf_model_file_options *options) {
    *options = sf_model_file_options_default();
    int error = args_int(a, "sh-degree", 0, SF_MAX_SH_DEGREE, &options->sh_degree);
    if (!error) error = read_bits(a, options->sh_bits);
    return error ? error : app_model_options(a, options);
}

/* Bytes of a regular file; -1: not a regular file. */
static long long bytes_of(const char *path) {
    struct stat st;
    return stat(path, &st) || !S_ISREG(st.st_mode) ? -1 : (long long)st.st_size;
}

typedef struct conversion {
    const char *in, *out, *project;
    long long bytes_in, bytes_out;
    sf_model *model, *again; /* as read from `in`, and from `out` */
    comparison compared;
} conversion;

static void print_result(const conversion *c) {
    double in = (double)c->bytes_in, out = (double)c->bytes_out;
    printf("%s: %lld bytes, %s: %lld bytes: %.2f times %s; %zu Gaussians, SH degree %d\n", c->in, c->bytes_in,
           c->out, c->bytes_out, fmax(in, out) / fmin(in, out), in < out ? "larger" : "smaller",
           sf_model_count(c->again), sf_model_sh_degree(c->again));
    compare_print(&c->compared);
}

static json_t *result_json(const conversion *c) {
    return json_pack("{s:o, s:o, s:I, s:I, s:f, s:I, s:i, s:o}", "in", app_json_text(c->in), "out",
                     app_json_text(c->out), "bytes_in", (json_int_t)c->bytes_in, "bytes_out",
                     (json_int_t)c->bytes_out, "ratio", (double)c->bytes_in / (double)c->bytes_out,
                     "gaussians", (json_int_t)sf_model_count(c->again), "sh_degree",
                     sf_model_sh_degree(c->again), "compared", compare_json(&c->compared));
}

/* What was written, read again and held against what it was made from. */
static int check_result(const args *a, sf_context *ctx, const sf_model_file_options *options, conversion *c) {
    sf_scene *scene = NULL;
    int error = sf_model_load_as(ctx, c->out, options, &c->again) ? app_fail(a, ctx) : 0;
    if (!error && c->project) error = app_load(a, ctx, c->project, &scene);
    if (!error && options->world) {
        double origin[3];
        sf_model_get_origin(c->model, origin);
        sf_model_set_origin(c->again, origin);
    }
    if (!error && scene) sf_scene_place_model(scene, c->model), sf_scene_place_model(scene, c->again);
    if (!error) error = compare_models(a, ctx, c->model, c->again, scene, &c->compared);
    sf_scene_destroy(&scene);
    c->bytes_in = bytes_of(c->in);
    c->bytes_out = bytes_of(c->out);
    if (!error && !args_value(a, "quiet")) print_result(c);
    const char *json = args_value(a, "json");
    if (!error && json) error = app_write_json(a, ctx, json, result_json(c));
    compare_free(&c->compared);
    return error;
}

static int convert(const args *a, sf_context *ctx, conversion *c) {
    sf_model_file_options options;
    int error = read_options(a, &options), moved = 0;
    if (!error) error = model_transform_apply(a, ctx, NULL, &moved);
    if (!error && moved && c->project) {
        app_say(a, c->project,
                "its views do not see the model where --up, --rotate, --scale or --move put it");
        error = EXIT_USAGE;
    }
    const char *json = args_value(a, "json");
    if (!error) error = app_check_model(a, ctx, c->out);
    if (!error && json) error = app_check_output(a, json);
    if (!error) error = app_load_model(a, ctx, c->in, &c->model);
    if (!error) error = model_transform_apply(a, ctx, c->model, &moved);
    if (!error && sf_model_save_as(c->model, c->out, &options)) error = app_fail(a, ctx);
    /* What went down a pipe cannot be read again. */
    return error || bytes_of(c->out) < 0 ? error : check_result(a, ctx, &options, c);
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    conversion c = {.in = a->positional[0], .out = a->positional[1]};
    c.project = a->positionals > 2 ? a->positional[2] : NULL;
    int error = app_context(a, &ctx);
    if (!error) error = convert(a, ctx, &c);
    sf_model_destroy(&c.again);
    sf_model_destroy(&c.model);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options,          model_options,           world_options,
                                           compensation_options, model_transform_options, compare_options,
                                           load_options,         common_options,          NULL};

const command command_convert = {
    .name = "convert",
    .synopsis = "IN OUT [PROJECT] [OPTIONS]",
    .summary = "Converts a model between .ply, .spz, .splat, .glb and .sog, by the endings of the names, and "
               "prints the loss of quality. It can rotate, scale, move and crop the model. Both files are "
               "rendered and compared, from the views of PROJECT or from a ring around the model.",
    .tables = tables,
    .least = 2,
    .most = 3,
    .run = run,
};
