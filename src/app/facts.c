/* facts.c - what a model takes, for logs. */
#include <sys/stat.h>

#include "app.h"

/* Floats of a Gaussian beside its harmonics: mean, quaternion, log-scales, logit-opacity. */
enum { PLAIN_FLOATS = 3 + 4 + 3 + 1, CHANNELS = 3 };

void app_log_model(json_t *result, const sf_model *model, const char *path) {
    json_int_t by_degree[SF_MAX_SH_DEGREE + 1] = {0}, parameters = 0;
    struct stat st;
    by_degree[sf_model_sh_degree(model)] = (json_int_t)sf_model_count(model);
    json_t *degrees = json_array();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++) {
        parameters += by_degree[degree] * (PLAIN_FLOATS + CHANNELS * (degree + 1) * (degree + 1));
        json_array_append_new(degrees, json_integer(by_degree[degree]));
    }
    json_object_set_new(result, "gaussians", json_integer((json_int_t)sf_model_count(model)));
    json_object_set_new(result, "parameters", json_integer(parameters));
    json_object_set_new(result, "sh_degrees", degrees);
    if (path && !stat(path, &st) && S_ISREG(st.st_mode))
        json_object_set_new(result, "bytes", json_integer((json_int_t)st.st_size));
}
