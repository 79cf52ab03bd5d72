/* calibration_file.c - calibrations as files: our JSON; OpenCV's YAML and COLMAP's cameras are read too. */
#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "../base/file.h"
#include "../io/colmap.h"
#include "../io/undistort.h"

#include <splatfit/calibrate.h>

enum { MOST_SIDE = 65535 };

static const uint64_t MAX_FILE_BYTES = 1 << 20;

/* Writing. */

static json_t *lens_json(const sf_lens *l) {
    return json_pack("{s:f s:f s:f s:f s:f s:f s:f s:f}", "fx", l->fx, "fy", l->fy, "cx", l->cx, "cy", l->cy,
                     "k1", l->k1, "k2", l->k2, "p1", l->p1, "p2", l->p2);
}

static json_t *calibration_json(const sf_calibration *c) {
    json_t *root =
        json_pack("{s:s s:i s:i}", "model", "OPENCV", "width", (int)c->width, "height", (int)c->height);
    json_t *lens = lens_json(&c->lens);
    int failed = json_object_update(root, lens) || json_object_set_new(root, "sigma", lens_json(&c->sigma));
    json_decref(lens);
    json_t *rest =
        json_pack("{s:f s:f s:f s:f s:f s:I s:I s:I s:I}", "rms_px", c->rms, "worst_rms_px", c->worst_rms,
                  "coverage", c->coverage, "tilt_most_deg", c->tilt_most, "tilt_spread_deg", c->tilt_spread,
                  "views", (json_int_t)c->views, "views_rejected", (json_int_t)c->views_rejected, "corners",
                  (json_int_t)c->corners, "corners_rejected", (json_int_t)c->corners_rejected);
    failed |= json_object_update(root, rest);
    json_decref(rest);
    if (!failed) return root;
    json_decref(root);
    return NULL;
}

static sf_status check(sf_context *ctx, sf_status status, const char *path, const sf_calibration *c) {
    const char *const names[] = {"width", "height"};
    const int32_t sides[] = {c->width, c->height};
    for (int i = 0; i < 2; i++)
        if (sides[i] < 1 || sides[i] > MOST_SIDE)
            return sf_fail(ctx, status, "%s: %s: %d is not in 1..%d", path, names[i], (int)sides[i],
                           MOST_SIDE);
    if (!sf_lens_is_valid(&c->lens))
        return sf_fail(ctx, status, "%s: fx, fy: %g, %g: the lens is not valid", path, c->lens.fx,
                       c->lens.fy);
    return SF_OK;
}

sf_status sf_calibration_save(sf_context *ctx, const sf_calibration *c, const char *path) {
    sf_status status = check(ctx, SF_ERR_ARGUMENT, path, c);
    if (status) return status;
    json_t *root = calibration_json(c);
    char *text = root ? json_dumps(root, JSON_INDENT(1)) : NULL;
    json_decref(root);
    if (!text) return sf_fail(ctx, SF_ERR_MEMORY, "%s: no memory for the calibration", path);
    size_t size = strlen(text);
    text[size] = '\n'; /* in place of the 0 */
    status = sf_write_file(ctx, path, text, size + 1);
    free(text);
    return status;
}

/* A file being read. */
typedef struct reader {
    sf_context *ctx;
    const char *path;
    uint8_t *data; /* followed by a 0 */
    size_t size;
    sf_calibration *c;
} reader;

static sf_status missing(const reader *r, const char *field) {
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: is missing", r->path, field);
}

static sf_status bad_number(const reader *r, const char *field) {
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: is not a number in its range", r->path, field);
}

/* Sides of pictures. */
static sf_status take_side(const reader *r, const char *field, double value, int32_t *side) {
    if (!(value >= 1 && value <= MOST_SIDE && value == floor(value))) return bad_number(r, field);
    *side = (int32_t)value;
    return SF_OK;
}

/* Our JSON. */

static sf_status get_real(const reader *r, const json_t *object, const char *key, int must, double *value) {
    const json_t *number = json_object_get(object, key);
    *value = 0;
    if (!number) return must ? missing(r, key) : SF_OK;
    *value = json_number_value(number);
    return json_is_number(number) && isfinite(*value) ? SF_OK : bad_number(r, key);
}

static sf_status get_count(const reader *r, const json_t *object, const char *key, size_t *count) {
    double value;
    sf_status status = get_real(r, object, key, 0, &value);
    if (status) return status;
    if (!(value >= 0 && value <= 1e9)) return bad_number(r, key);
    *count = (size_t)value;
    return SF_OK;
}

/* What a lens must have: all that is before k1. */
static sf_status get_lens(const reader *r, const json_t *object, int must, sf_lens *lens) {
    const char *const keys[] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"};
    double *const values[] = {&lens->fx, &lens->fy, &lens->cx, &lens->cy,
                              &lens->k1, &lens->k2, &lens->p1, &lens->p2};
    sf_status status = SF_OK;
    for (int i = 0; i < 8 && !status; i++) status = get_real(r, object, keys[i], must && i < 4, values[i]);
    return status;
}

static sf_status get_rest(const reader *r, const json_t *root) {
    const struct {
        const char *key;
        double *value;
    } reals[] = {{"rms_px", &r->c->rms},
                 {"worst_rms_px", &r->c->worst_rms},
                 {"coverage", &r->c->coverage},
                 {"tilt_most_deg", &r->c->tilt_most},
                 {"tilt_spread_deg", &r->c->tilt_spread}};
    sf_status status = SF_OK;
    for (int i = 0; i < 5 && !status; i++) status = get_real(r, root, reals[i].key, 0, reals[i].value);
    if (!status) status = get_count(r, root, "views", &r->c->views);
    if (!status) status = get_count(r, root, "views_rejected", &r->c->views_rejected);
    if (!status) status = get_count(r, root, "corners", &r->c->corners);
    if (!status) status = get_count(r, root, "corners_rejected", &r->c->corners_rejected);
    return status;
}

static sf_status read_object(const reader *r, const json_t *root) {
    const json_t *model = json_object_get(root, "model");
    const char *name = json_string_value(model);
    double width, height;
    if (!json_is_object(root)) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: is not an object", r->path);
    if (model && (!name || (strcmp(name, "OPENCV") && strcmp(name, "PINHOLE"))))
        return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: model: \"%.40s\" is neither OPENCV nor PINHOLE",
                       r->path, name ? name : "(no text)");
    sf_status status = get_real(r, root, "width", 1, &width);
    if (!status) status = take_side(r, "width", width, &r->c->width);
    if (!status) status = get_real(r, root, "height", 1, &height);
    if (!status) status = take_side(r, "height", height, &r->c->height);
    if (!status) status = get_lens(r, root, 1, &r->c->lens);
    const json_t *sigma = json_object_get(root, "sigma");
    if (!status && sigma) status = get_lens(r, sigma, 0, &r->c->sigma);
    return status ? status : get_rest(r, root);
}

static sf_status read_json(const reader *r) {
    json_error_t error;
    json_t *root = json_loadb((const char *)r->data, r->size, JSON_REJECT_DUPLICATES, &error);
    if (!root) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: line %d: %s", r->path, error.line, error.text);
    sf_status status = read_object(r, root);
    json_decref(root);
    return status;
}

/* OpenCV's YAML: of that language as much as cv::FileStorage writes. */

/* What follows "key:" at the beginning of a line; NULL: there is no such line. */
static const char *find_key(const char *text, const char *key) {
    size_t n = strlen(key);
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (!strncmp(line, key, n) && line[n] == ':') return line + n + 1;
    }
    return NULL;
}

/* The numbers between the brackets of the key's "data: [ ... ]", which ends before the next key. */
static sf_status get_list(const reader *r, const char *key, double *values, size_t most, size_t *count) {
    const char *at = find_key((const char *)r->data, key), *data = at ? strstr(at, "data:") : NULL;
    *count = 0;
    if (!at) return missing(r, key);
    for (const char *line = strchr(at, '\n'); data && line && line < data; line = strchr(line + 1, '\n'))
        if (line[1] != ' ' && line[1] != '\t') data = NULL;
    at = data ? data + strspn(data + 5, " \t\r\n") + 5 : NULL;
    if (!at || *at != '[') return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: has no data: [...]", r->path, key);
    for (at++;; at++) {
        char *end;
        at += strspn(at, " \t\r\n");
        if (*at == ']' && !*count) return SF_OK;
        if (*count == most)
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: more than %zu numbers", r->path, key, most);
        values[*count] = strtod(at, &end);
        if (end == at || !isfinite(values[*count])) return bad_number(r, key);
        ++*count;
        at = end + strspn(end, " \t\r\n");
        if (*at == ']') return SF_OK;
        if (*at != ',') return bad_number(r, key);
    }
}

static sf_status get_scalar(const reader *r, const char *key, int32_t *side) {
    const char *at = find_key((const char *)r->data, key);
    char *end;
    if (!at) return missing(r, key);
    double value = strtod(at, &end);
    if (end == at || (*end && !strchr(" \t\r\n", *end))) return bad_number(r, key);
    return take_side(r, key, value, side);
}

static sf_status read_matrix(const reader *r) {
    static const char key[] = "camera_matrix";
    double m[9];
    size_t count;
    sf_status status = get_list(r, key, m, 9, &count);
    if (status) return status;
    if (count != 9 || m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: is not [fx, 0, cx, 0, fy, cy, 0, 0, 1]", r->path, key);
    if (m[1] != 0)
        return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: %s: skew: %g is not supported, only 0", r->path, key,
                       m[1]);
    r->c->lens.fx = m[0];
    r->c->lens.fy = m[4];
    r->c->lens.cx = m[2] + 0.5; /* OpenCV's first pixel has its middle at 0 */
    r->c->lens.cy = m[5] + 0.5;
    return SF_OK;
}

static sf_status read_distortion(const reader *r) {
    static const char key[] = "distortion_coefficients";
    static const char *const higher[] = {"k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"};
    enum { OURS = 4, MOST = 14 };
    double d[MOST] = {0};
    size_t count;
    sf_status status = get_list(r, key, d, MOST, &count);
    if (status) return status;
    if (count < OURS)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: %zu numbers are not 4 or 5", r->path, key, count);
    for (size_t i = OURS; i < count; i++)
        if (fabs(d[i]) > 1e-9)
            return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: %s: %s: %g is not supported, only 0", r->path,
                           key, higher[i - OURS], d[i]);
    r->c->lens.k1 = d[0];
    r->c->lens.k2 = d[1];
    r->c->lens.p1 = d[2];
    r->c->lens.p2 = d[3];
    return SF_OK;
}

/* ROS names the model; plumb_bob is this one. */
static sf_status check_distortion_model(const reader *r) {
    const char *model = find_key((const char *)r->data, "distortion_model");
    if (!model) return SF_OK;
    model += strspn(model, " \t\"'");
    if (!strncmp(model, "plumb_bob", 9) || !strncmp(model, "rational_polynomial", 19)) return SF_OK;
    return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: distortion_model: %.*s is not supported", r->path,
                   (int)strcspn(model, " \t\r\n\"'"), model);
}

static sf_status read_yaml(const reader *r) {
    sf_status status = get_scalar(r, "image_width", &r->c->width);
    if (!status) status = get_scalar(r, "image_height", &r->c->height);
    if (!status) status = check_distortion_model(r);
    if (!status) status = read_matrix(r);
    return status ? status : read_distortion(r);
}

/* Numbers have a point in every locale of the program. */
static sf_status read_plainly(const reader *r) {
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) return sf_fail(r->ctx, SF_ERR_MEMORY, "%s: out of memory", r->path);
    locale_t before = uselocale(plain);
    sf_status status = read_yaml(r);
    uselocale(before);
    freelocale(plain);
    return status;
}

/* COLMAP. */

static sf_status read_colmap(const reader *r, int binary) {
    int width = 0, height = 0;
    sf_status status =
        sf_colmap_read_camera(r->ctx, r->path, binary, r->data, r->size, &width, &height, &r->c->lens);
    r->c->width = width;
    r->c->height = height;
    return status;
}

/* Which. */

/* COLMAP's number of cameras is small: most of its eight bytes are 0, which no text holds. */
static sf_status read_any(const reader *r) {
    const char *text = (const char *)r->data;
    if (memchr(r->data, 0, r->size)) return read_colmap(r, 1);
    text += strspn(text, " \t\r\n");
    if (!*text) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: is empty", r->path);
    if (*text == '{' || *text == '[') return read_json(r);
    if (!strncmp(text, "%YAML", 5) || find_key(text, "camera_matrix") || find_key(text, "image_width"))
        return read_plainly(r);
    if (*text == '#' || (*text >= '0' && *text <= '9')) return read_colmap(r, 0);
    return sf_fail(r->ctx, SF_ERR_FORMAT,
                   "%s: is neither a calibration of splatfit, nor OpenCV's YAML, nor COLMAP's cameras",
                   r->path);
}

sf_status sf_calibration_load(sf_context *ctx, const char *path, sf_calibration *calibration) {
    reader r = {.ctx = ctx, .path = path, .c = calibration};
    memset(calibration, 0, sizeof *calibration);
    sf_status status = sf_read_file(ctx, path, MAX_FILE_BYTES, &r.data, &r.size);
    if (status) return status;
    status = read_any(&r);
    sf_free(ctx, r.data);
    if (!status) status = check(ctx, SF_ERR_FORMAT, path, calibration);
    if (status) memset(calibration, 0, sizeof *calibration);
    return status;
}
