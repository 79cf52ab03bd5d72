/* calibration_file.c - calibrations as files: our JSON; OpenCV's and COLMAP's are read too. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "../base/file.h"
#include "../io/colmap.h"
#include "../io/undistort.h"
#include "opencv_file.h"

#include <splatfit/calibrate.h>

enum { MOST_SIDE = 65535 };

static const uint64_t MAX_FILE_BYTES = 1 << 20;

/* Writing. */

static json_t *lens_json(const sf_lens *l) {
    return json_pack("{s:f s:f s:f s:f s:f s:f s:f s:f s:f}", "fx", l->fx, "fy", l->fy, "cx", l->cx, "cy",
                     l->cy, "k1", l->k1, "k2", l->k2, "p1", l->p1, "p2", l->p2, "k3", l->k3);
}

static json_t *calibration_json(const sf_calibration *c) {
    json_t *root = json_pack("{s:s s:i s:i}", "model", c->lens.k3 != 0 ? "FULL_OPENCV" : "OPENCV", "width",
                             (int)c->width, "height", (int)c->height);
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
    const char *const keys[] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
    double *const values[] = {&lens->fx, &lens->fy, &lens->cx, &lens->cy, &lens->k1,
                              &lens->k2, &lens->p1, &lens->p2, &lens->k3};
    sf_status status = SF_OK;
    for (int i = 0; i < 9 && !status; i++) status = get_real(r, object, keys[i], must && i < 4, values[i]);
    return status;
}

/* Of FULL_OPENCV, what an sf_lens does not have. */
static sf_status check_higher(const reader *r, const json_t *root) {
    static const char *const keys[] = {"k4", "k5", "k6"};
    for (int i = 0; i < 3; i++) {
        double value;
        sf_status status = get_real(r, root, keys[i], 0, &value);
        if (status) return status;
        if (value != 0)
            return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: %s: %g is not supported, only 0", r->path,
                           keys[i], value);
    }
    return SF_OK;
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
    if (model &&
        (!name || (strcmp(name, "OPENCV") && strcmp(name, "FULL_OPENCV") && strcmp(name, "PINHOLE"))))
        return sf_fail(r->ctx, SF_ERR_UNSUPPORTED,
                       "%s: model: \"%.40s\" is none of OPENCV, FULL_OPENCV, PINHOLE", r->path,
                       name ? name : "(no text)");
    sf_status status = get_real(r, root, "width", 1, &width);
    if (!status) status = take_side(r, "width", width, &r->c->width);
    if (!status) status = get_real(r, root, "height", 1, &height);
    if (!status) status = take_side(r, "height", height, &r->c->height);
    if (!status) status = get_lens(r, root, 1, &r->c->lens);
    if (!status) status = check_higher(r, root);
    const json_t *sigma = json_object_get(root, "sigma");
    if (!status && sigma) status = get_lens(r, sigma, 0, &r->c->sigma);
    return status ? status : get_rest(r, root);
}

static sf_status read_json(const reader *r) {
    json_error_t error;
    json_t *root = json_loadb((const char *)r->data, r->size, JSON_REJECT_DUPLICATES, &error);
    if (!root) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: line %d: %s", r->path, error.line, error.text);
    sf_status status =
        sf_opencv_is_json(root) ? sf_opencv_read(r->ctx, r->path, NULL, root, r->c) : read_object(r, root);
    json_decref(root);
    return status;
}

/* COLMAP. */

static sf_status read_colmap(const reader *r, int binary) {
    return sf_colmap_read_camera(r->ctx, r->path, binary, r->data, r->size, r->c);
}

/* Which. */

/* COLMAP's number of cameras is small: most of its eight bytes are 0, which no text holds. */
static sf_status read_any(const reader *r) {
    const char *text = (const char *)r->data;
    if (memchr(r->data, 0, r->size)) return read_colmap(r, 1);
    text += strspn(text, " \t\r\n");
    if (!*text) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: is empty", r->path);
    if (*text == '{' || *text == '[') return read_json(r);
    if (sf_opencv_is_text(text)) return sf_opencv_read(r->ctx, r->path, text, NULL, r->c);
    if (*text == '#' || (*text >= '0' && *text <= '9')) return read_colmap(r, 0);
    return sf_fail(
        r->ctx, SF_ERR_FORMAT,
        "%s: is neither a calibration of splatfit, nor one of OpenCV (YAML, XML, JSON), nor COLMAP's cameras",
        r->path);
}

sf_status sf_calibration_load(sf_context *ctx, const char *path, sf_calibration *calibration) {
    reader r = {.ctx = ctx, .path = path, .c = calibration};
    memset(calibration, 0, sizeof *calibration);
    sf_status status = sf_read_text(ctx, path, MAX_FILE_BYTES, &r.data, &r.size);
    if (status) return status;
    status = read_any(&r);
    sf_free(ctx, r.data);
    if (!status) status = check(ctx, SF_ERR_FORMAT, path, calibration);
    if (status) memset(calibration, 0, sizeof *calibration);
    return status;
}
