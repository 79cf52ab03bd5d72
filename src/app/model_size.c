/* model_size.c - the size of a model, for logs. */
#include <sys/stat.h>

#include "app.h"

void app_json_origin(json_t *to, const double origin[3]) {
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0)
        json_object_set_new(to, "origin", app_json_numbers(origin, 3));
}

void app_log_model(json_t *result, const sf_model *model, const char *path) {
    size_t by_degree[SF_MAX_SH_DEGREE + 1];
    struct stat st;
    sf_model_degrees(model, by_degree);
    json_t *degrees = json_array();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++)
        json_array_append_new(degrees, json_integer((json_int_t)by_degree[degree]));
    json_object_set_new(result, "gaussians", json_integer((json_int_t)sf_model_count(model)));
    json_object_set_new(result, "parameters", json_integer((json_int_t)sf_model_floats(model)));
    json_object_set_new(result, "sh_degrees", degrees);
    double origin[3];
    sf_model_get_origin(model, origin);
    app_json_origin(result, origin);
    if (path && !stat(path, &st) && S_ISREG(st.st_mode))
        json_object_set_new(result, "bytes", json_integer((json_int_t)st.st_size));
}
