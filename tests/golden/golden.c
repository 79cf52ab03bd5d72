/* golden.c - reads golden cases, finds them, measures distances from them. */
#define _GNU_SOURCE
#include "golden.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

/* Where a value is looked for, for the messages. */
typedef struct place {
    const char *path;
    const char *group; /* "" at the root */
    json_t *object;
} place;

static json_t *member(place in, const char *key) {
    json_t *value = json_object_get(in.object, key);
    if (!value) fail_msg("%s: %s%s: missing", in.path, in.group, key);
    return value;
}

static place group(place in, const char *key, const char *prefix) {
    return (place){in.path, prefix, member(in, key)};
}

static double number(place in, const char *key) {
    json_t *value = member(in, key);
    if (!json_is_number(value)) fail_msg("%s: %s%s: not a number", in.path, in.group, key);
    return json_number_value(value);
}

/* The sizes of nested lists, outermost first. */
#define NO_MORE SIZE_MAX
#define SHAPE(...)                                                                                           \
    (const size_t[]) { __VA_ARGS__, NO_MORE }

/* Flattens nested lists of that shape, of numbers or booleans; 0 if they are not that. */
static int flatten(const json_t *value, const size_t *dims, double **out) {
    if (*dims == NO_MORE) {
        if (!json_is_number(value) && !json_is_boolean(value)) return 0;
        *(*out)++ = json_is_boolean(value) ? json_is_true(value) : json_number_value(value);
        return 1;
    }
    if (!json_is_array(value) || json_array_size(value) != *dims) return 0;
    for (size_t i = 0; i < *dims; i++)
        if (!flatten(json_array_get(value, i), dims + 1, out)) return 0;
    return 1;
}

static void read_into(place in, const char *key, const size_t *dims, double *out) {
    if (!flatten(member(in, key), dims, &out)) fail_msg("%s: %s%s: another shape", in.path, in.group, key);
}

static double *array(place in, const char *key, const size_t *dims) {
    size_t size = 1;
    for (const size_t *d = dims; *d != NO_MORE; d++) size *= *d;
    double *out = test_ref_numbers(size);
    read_into(in, key, dims, out);
    return out;
}

static test_ref_gaussians gaussians(place in, size_t n, int sh_degree) {
    size_t k = (size_t)(sh_degree + 1) * (size_t)(sh_degree + 1);
    return (test_ref_gaussians){
        .means = array(in, "means", SHAPE(n, 3)),
        .quats = array(in, "quats", SHAPE(n, 4)),
        .log_scales = array(in, "log_scales", SHAPE(n, 3)),
        .logit_opacities = array(in, "logit_opacities", SHAPE(n)),
        .sh = array(in, "sh", SHAPE(n, k, 3)),
    };
}

static sf_camera camera(place in) {
    sf_camera c = {.width = (int32_t)number(in, "width"),
                   .height = (int32_t)number(in, "height"),
                   .fx = number(in, "fx"),
                   .fy = number(in, "fy"),
                   .cx = number(in, "cx"),
                   .cy = number(in, "cy")};
    read_into(in, "R_cw", SHAPE(3, 3), c.R_cw);
    read_into(in, "t_cw", SHAPE(3), c.t_cw);
    if (c.width < 1 || c.height < 1) fail_msg("%s: camera: width, height: below 1", in.path);
    return c;
}

static void scene(place root, test_ref_scene *s) {
    place g = group(root, "gaussians", "gaussians.");
    double degree = number(root, "sh_degree");
    if (!(degree >= 0 && degree <= 3)) fail_msg("%s: sh_degree: %g", root.path, degree);
    s->camera = camera(group(root, "camera", "camera."));
    s->count = json_array_size(member(g, "means"));
    s->sh_degree = (int)degree;
    s->gaussians = gaussians(g, s->count, s->sh_degree);
    read_into(root, "background", SHAPE(3), s->background);
    s->near_plane = 0.2;
    s->antialiased = json_is_true(member(root, "antialias"));
}

static void expectation(place root, test_golden *c) {
    place e = group(root, "expect", "expect."), d = group(root, "gradient", "gradient.");
    size_t n = c->scene.count, w = (size_t)c->scene.camera.width, h = (size_t)c->scene.camera.height;
    c->image = array(e, "image", SHAPE(h, w, 3));
    c->transmittance = array(e, "transmittance", SHAPE(h, w));
    c->depth = array(e, "depth", SHAPE(h, w));
    c->loss = number(e, "loss");
    c->l1 = number(e, "l1");
    c->ssim = number(e, "ssim");
    c->contributing_pairs = (uint64_t)number(e, "contributing_pairs");
    c->visible = array(e, "visible", SHAPE(n));
    c->camera_points = array(e, "camera_points", SHAPE(n, 3));
    c->means2d = array(e, "means2d", SHAPE(n, 2));
    c->cov2d = array(e, "cov2d", SHAPE(n, 3));
    c->conics = array(e, "conics", SHAPE(n, 3));
    c->rgb = array(e, "rgb", SHAPE(n, 3));
    c->d_image = array(d, "image", SHAPE(h, w, 3));
    c->gradient.gaussians = gaussians(d, n, c->scene.sh_degree);
    read_into(d, "pose_twist", SHAPE(6), c->gradient.pose);
}

void test_golden_load(const char *path, test_golden *c) {
    json_error_t error;
    place root = {path, "", json_load_file(path, 0, &error)};
    if (!root.object) fail_msg("%s: line %d: %s", path, error.line, error.text);
    *c = (test_golden){0};
    const char *name = json_string_value(member(root, "name"));
    const char *kind = json_string_value(json_object_get(root.object, "kind"));
    snprintf(c->name, sizeof c->name, "%s", name ? name : "?");
    c->long_needles = strcmp(kind ? kind : c->name, "long-needles") == 0;
    scene(root, &c->scene);
    c->lambda = number(root, "lambda_dssim");
    c->target =
        array(root, "target", SHAPE((size_t)c->scene.camera.height, (size_t)c->scene.camera.width, 3));
    expectation(root, c);
    json_decref(root.object);
}

void test_golden_free(test_golden *c) {
    double *arrays[] = {c->target,  c->image, c->transmittance, c->depth, c->visible, c->camera_points,
                        c->means2d, c->cov2d, c->conics,        c->rgb,   c->d_image};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) free(arrays[i]);
    test_ref_gaussians_free(&c->scene.gaussians);
    test_ref_gaussians_free(&c->gradient.gaussians);
    *c = (test_golden){0};
}

static int is_case(const struct dirent *entry) {
    size_t length = strlen(entry->d_name);
    return length > 5 && strcmp(entry->d_name + length - 5, ".json") == 0;
}

/* *state: the folder. */
static void finds_golden_cases(void **state) {
    fail_msg("%s: no golden case (*.json)", (const char *)*state);
}

static struct CMUnitTest test_of(CMUnitTestFunction run, char *name, char *state) {
    if (!name || !state) abort();
    return (struct CMUnitTest){.name = name, .test_func = run, .initial_state = state};
}

static char *joined(const char *a, const char *between, const char *b) {
    char *text = NULL;
    return asprintf(&text, "%s%s%s", a, between, b) < 0 ? NULL : text;
}

size_t test_golden_list(CMUnitTestFunction run, const char *prefix, struct CMUnitTest **tests) {
    const char *folder = getenv("SPLATFIT_GOLDEN");
    if (!folder || !*folder) folder = "tests/golden";
    struct dirent **entries = NULL;
    int found = scandir(folder, &entries, is_case, alphasort);
    size_t count = found > 0 ? (size_t)found : 0;
    *tests = calloc(count + 1, sizeof **tests);
    if (!*tests) abort();
    for (size_t i = 0; i < count; i++) {
        const char *name = entries[i]->d_name;
        (*tests)[i] = test_of(run, joined(prefix, " ", name), joined(folder, "/", name));
        free(entries[i]);
    }
    free(entries);
    if (count) return count;
    **tests = test_of(finds_golden_cases, joined(prefix, " ", "no case"), joined(folder, "", ""));
    return 1;
}

void test_golden_list_free(struct CMUnitTest *tests, size_t count) {
    for (size_t i = 0; i < count; i++) {
        free((char *)(uintptr_t)tests[i].name);
        free(tests[i].initial_state);
    }
    free(tests);
}

double test_golden_worst(test_rows r, const double *got, const double *expected) {
    double worst = 0;
    for (size_t i = 0; i < r.rows * r.width; i++) {
        if (r.used && !r.used[i / r.width]) continue;
        double error = fabs(got[i] - expected[i]);
        worst = isnan(error) ? INFINITY : fmax(worst, error);
    }
    return worst;
}

double test_golden_largest(test_rows r, const double *values) {
    double largest = 0;
    for (size_t i = 0; i < r.rows * r.width; i++)
        if (!r.used || r.used[i / r.width]) largest = fmax(largest, fabs(values[i]));
    return largest;
}
