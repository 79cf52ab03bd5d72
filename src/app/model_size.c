/* model_size.c - the size of a model, for logs. */
#include <sys/stat.h>

#include "ranks.h"

void app_json_origin(json_t *to, const double origin[3]) {
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0)
        json_object_set_new(to, "origin", app_json_numbers(origin, 3));
}

void app_log_parts(sf_context *ctx, json_t *result, const sf_model *part, const char *path) {
    enum { FLOATS = SF_MAX_SH_DEGREE + 1, COUNT, SUMS };
    size_t by_degree[SF_MAX_SH_DEGREE + 1];
    double sums[SUMS], origin[3];
    struct stat st;
    sf_model_degrees(part, by_degree);
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++) sums[degree] = (double)by_degree[degree];
    sums[FLOATS] = (double)sf_model_floats(part);
    sums[COUNT] = (double)sf_model_count(part);
    if (ctx) app_sum_over_ranks(ctx, sums, SUMS);
    json_t *degrees = json_array();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++)
        json_array_append_new(degrees, json_integer((json_int_t)sums[degree]));
    json_object_set_new(result, "gaussians", json_integer((json_int_t)sums[COUNT]));
    json_object_set_new(result, "parameters", json_integer((json_int_t)sums[FLOATS]));
    json_object_set_new(result, "sh_degrees", degrees);
    sf_model_get_origin(part, origin);
    app_json_origin(result, origin);
    if (path && !stat(path, &st) && S_ISREG(st.st_mode))
        json_object_set_new(result, "bytes", json_integer((json_int_t)st.st_size));
}

void app_log_model(json_t *result, const sf_model *model, const char *path) {
    app_log_parts(NULL, result, model, path);
}
