/* info.c - splatfit info: what a model or a project holds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "app.h"

/* Least, mean and greatest of some values. */
typedef struct range {
    double least, sum, most;
} range;

static range range_of(const float *values, size_t n, size_t stride) {
    range r = {INFINITY, 0, -INFINITY};
    for (size_t i = 0; i < n; i++) {
        double x = (double)values[i * stride];
        r.least = fmin(r.least, x);
        r.most = fmax(r.most, x);
        r.sum += x;
    }
    return r;
}

static void print_model(const sf_model *model, const sf_gaussians *g, long long bytes) {
    size_t n = sf_model_count(model);
    printf("%zu Gaussians, SH degree %d, %lld bytes%s\n", n, sf_model_sh_degree(model), bytes,
           sf_model_antialiased(model) ? ", anti-aliased (mip)" : "");
    if (!n) return;
    static const char axes[] = "xyz";
    double origin[3];
    sf_model_get_origin(model, origin);
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0)
        printf("origin         %.17g %.17g %.17g: coordinates are relative to it\n", origin[0], origin[1],
               origin[2]);
    for (size_t k = 0; k < 3; k++) {
        range r = range_of(g->means + k, n, 3);
        printf("mean %c         %12.5g .. %.5g\n", axes[k], r.least, r.most);
    }
    range scale = range_of(g->log_scales, 3 * n, 1);
    printf("scale          %12.5g .. %.5g, geometric mean %.5g\n", exp(scale.least), exp(scale.most),
           exp(scale.sum / (double)(3 * n)));
    size_t needles = 0;
    double opacity = 0;
    for (size_t i = 0; i < n; i++) {
        range axes_of = range_of(g->log_scales + 3 * i, 3, 1);
        double middle = axes_of.sum - axes_of.least - axes_of.most;
        needles += axes_of.most - middle > log(100);
        opacity += 1 / (1 + exp(-(double)g->logit_opacities[i]));
    }
    printf("opacity        mean %.4f\n", opacity / (double)n);
    printf("needles        %zu with a longest axis above 100 times the middle one\n", needles);
}

/* How many Gaussians use which bands, and what that makes of the model. */
static int print_degrees(const args *a, sf_context *ctx, sf_model *model) {
    size_t count[SF_MAX_SH_DEGREE + 1];
    if (sf_model_pack(model)) return app_fail(a, ctx);
    sf_model_degrees(model, count);
    printf("SH degrees    ");
    for (int degree = 0; degree <= sf_model_sh_degree(model); degree++)
        printf("%s %zu of degree %d", degree ? "," : "", count[degree], degree);
    printf("\nfloats         %zu without bands that are 0\n", sf_model_floats(model));
    return 0;
}

static int info_model(const args *a, sf_context *ctx, const char *path) {
    sf_model *model = NULL;
    if (sf_model_load(ctx, path, &model)) return app_fail(a, ctx);
    size_t n = sf_model_count(model);
    float *values = malloc((7 * n + 1) * sizeof *values);
    int error = values ? 0 : app_say(a, path, "out of memory");
    if (!error) {
        sf_gaussians g = {.means = values, .log_scales = values + 3 * n, .logit_opacities = values + 6 * n};
        struct stat st = {0};
        long long bytes = stat(path, &st) ? 0 : (long long)st.st_size;
        error = sf_model_get(model, 0, n, &g) ? app_fail(a, ctx) : 0;
        if (!error) print_model(model, &g, bytes);
        if (!error && n) error = print_degrees(a, ctx, model);
    }
    free(values);
    sf_model_destroy(&model);
    return error;
}

static int info_cpu(const sf_context *ctx) {
    sf_isa_info info;
    sf_kernel_info kernel;
    printf("%d threads\n", sf_context_threads(ctx));
    for (size_t i = 0; !sf_isa_describe(i, &info); i++)
        printf("%-12s %s\n", info.name,
               !info.built                               ? "not built"
               : !info.usable                            ? "built, not on this machine"
               : !strcmp(info.name, sf_context_isa(ctx)) ? "in use"
                                                         : "usable");
    for (size_t i = 0; !sf_kernel_describe(ctx, i, &kernel); i++)
        printf("%-12s %s\n", kernel.name, kernel.isa);
    return 0;
}

static const arg_option own_options[] = {
    {"build", 0, NULL,
     "instead, print the libraries that this program was built with, and those that are missing"},
    {"cpu", 0, NULL, "instead, print the threads and the kernel levels of this machine"},
    {"json", 0, "FILE",
     "for a project: also write the output as JSON; -: to standard output, in place of the text"},
    {0},
};

/* What says how a project is read, or what is written of it, and would do nothing here. */
static int refuse_project_options(const args *a, const char *what) {
    if (!args_value(a, "json")) return app_refuse_load_options(a, what);
    args_error(a->command, "--json: goes with a project, not with %s", what);
    return EXIT_USAGE;
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    const char *path = a->positional[0];
    int cpu = args_value(a, "cpu") != NULL;
    if (args_value(a, "build")) {
        int wrong = refuse_project_options(a, "--build");
        if (!wrong) app_parts();
        return wrong;
    }
    if (!path && !cpu) {
        app_say(a, "an argument is missing", "a model or a project, or --cpu or --build");
        return EXIT_USAGE;
    }
    int model = !cpu && app_names_model(path);
    int error = cpu ? refuse_project_options(a, "--cpu") : model ? refuse_project_options(a, path) : 0;
    if (!error) error = app_context(a, &ctx);
    if (error) return error;
    if (cpu)
        error = info_cpu(ctx);
    else
        error = model ? info_model(a, ctx, path) : app_info_project(a, ctx, path);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, load_options, common_options, NULL};

const command command_info = {
    .name = "info",
    .synopsis = "FILE [OPTIONS]",
    .summary =
        "Describes a model or a project. Of a project's pictures and masks only the headers are read: damage "
        "behind them is not seen.",
    .tables = tables,
    .least = 0,
    .most = 1,
    .run = run,
};
