/* opencv_file.c - see opencv_file.h. Of YAML and XML as much as cv::FileStorage (OpenCV 4) writes. */
#include "opencv_file.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/context.h"

enum { MOST_SIDE = 65535, WORD = 40 };

static const char BLANKS[] = " \t\r\n";

/* Names that OpenCV's samples and programs give, the most usual one first. */
static const char *const matrix_keys[] = {"camera_matrix", "cameraMatrix", "K", NULL};
static const char *const distortion_keys[] = {"distortion_coefficients", "dist_coeffs", "distCoeffs", "D",
                                              NULL};
static const char *const size_keys[] = {"image_size", "imageSize", NULL};

typedef struct storage {
    sf_context *ctx;
    const char *path, *text;
    const json_t *root; /* NULL: text */
    int is_xml;
} storage;

/* The text of a value. */
typedef struct span {
    const char *at, *end;
} span;

static sf_status missing(const storage *s, const char *key) {
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is missing", s->path, key);
}

static sf_status bad_number(const storage *s, const char *key) {
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is not a number in its range", s->path, key);
}

/* Values by their keys. */

/* From "key:" at the beginning of a line to the next line that is not indented. */
static int find_line(const char *text, const char *key, span *value) {
    size_t n = strlen(key);
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, key, n) || line[n] != ':') continue;
        value->at = line + n + 1;
        value->end = strchr(value->at, '\n');
        while (value->end && strchr(BLANKS, value->end[1]) && value->end[1])
            value->end = strchr(value->end + 1, '\n');
        if (!value->end) value->end = value->at + strlen(value->at);
        return 1;
    }
    return 0;
}

/* What the element `key` of the root element holds. */
static int find_element(const char *text, const char *key, span *value) {
    size_t n = strlen(key);
    int depth = 0, inside = 0;
    for (const char *at = strchr(text, '<'); at; at = strchr(at + 1, '<')) {
        const char *end = strncmp(at, "<!--", 4) ? strchr(at, '>') : strstr(at, "-->");
        if (!end) return 0;
        if (at[1] == '/') {
            value->end = at;
            if (--depth == 1 && inside) return 1;
        } else if (at[1] != '?' && at[1] != '!' && end[-1] != '/') {
            if (++depth == 2 && !strncmp(at + 1, key, n) && strchr(" \t\r\n>", at[1 + n])) {
                value->at = end + 1;
                inside = 1;
            }
        }
        at = end;
    }
    return 0;
}

static int find(const storage *s, const char *key, span *value) {
    return s->is_xml ? find_element(s->text, key, value) : find_line(s->text, key, value);
}

static int has(const storage *s, const char *key) {
    span value;
    return s->root ? json_object_get(s->root, key) != NULL : find(s, key, &value);
}

static const char *first_of(const storage *s, const char *const keys[]) {
    while (*keys && !has(s, *keys)) keys++;
    return *keys;
}

/* The first word, without quotes; numbers and truths of JSON as YAML has them. "": there is none. */
static void get_word(const storage *s, const char *key, char word[WORD]) {
    span value;
    *word = 0;
    if (s->root) {
        const json_t *v = json_object_get(s->root, key);
        if (json_is_string(v)) snprintf(word, WORD, "%s", json_string_value(v));
        if (json_is_number(v)) snprintf(word, WORD, "%g", json_number_value(v));
        if (json_is_boolean(v)) snprintf(word, WORD, "%s", json_is_true(v) ? "true" : "false");
    } else if (find(s, key, &value)) {
        value.at += strspn(value.at, " \t\r\n\"'");
        snprintf(word, WORD, "%.*s", (int)strcspn(value.at, " \t\r\n\"'<"), value.at);
    }
}

/* Lists of numbers. */

static sf_status add(const storage *s, const char *key, double number, double *values, size_t most,
                     size_t *count) {
    if (!isfinite(number)) return bad_number(s, key);
    if (*count == most)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: more than %zu numbers", s->path, key, most);
    values[(*count)++] = number;
    return SF_OK;
}

/* Of JSON, rows within rows too. */
static sf_status add_items(const storage *s, const char *key, const json_t *list, double *values, size_t most,
                           size_t *count) {
    sf_status status = SF_OK;
    for (size_t i = 0; i < json_array_size(list) && !status; i++) {
        const json_t *item = json_array_get(list, i);
        if (json_is_array(item))
            status = add_items(s, key, item, values, most, count);
        else
            status = json_is_number(item) ? add(s, key, json_number_value(item), values, most, count)
                                          : bad_number(s, key);
    }
    return status;
}

/* Of XML, numbers between blanks. */
static sf_status add_words(const storage *s, const char *key, span text, double *values, size_t most,
                           size_t *count) {
    sf_status status = SF_OK;
    while (!status) {
        char *end;
        text.at += strspn(text.at, BLANKS);
        if (text.at >= text.end) return SF_OK;
        double number = strtod(text.at, &end);
        status = end == text.at ? bad_number(s, key) : add(s, key, number, values, most, count);
        text.at = end;
    }
    return status;
}

/* Of YAML, [1, 2], rows within rows too. */
static sf_status add_flow(const storage *s, const char *key, span text, double *values, size_t most,
                          size_t *count) {
    int depth = 0, ready = 1; /* for an item, not for a comma */
    do {
        char *end;
        text.at += strspn(text.at, BLANKS);
        char c = text.at < text.end ? *text.at++ : 0;
        if (!c || (ready ? c == ',' : c != ',' && c != ']')) return bad_number(s, key);
        if (c == ']' && ready && text.at[-2] != '[' && *count) return bad_number(s, key);
        if (c == '[') depth++;
        if (c == ']') depth--;
        if (c == ',' || c == '[' || c == ']') {
            ready = c != ']';
            continue;
        }
        double number = strtod(--text.at, &end);
        sf_status status = end == text.at ? bad_number(s, key) : add(s, key, number, values, most, count);
        if (status) return status;
        text.at = end;
        ready = 0;
    } while (depth);
    return SF_OK;
}

/* The text between `open` and `close`, or to the end where `close` is NULL. */
static int narrow(span *value, const char *open, const char *close) {
    const char *at = strstr(value->at, open), *end = at && close ? strstr(at, close) : value->end;
    if (!at || at >= value->end || !end || end > value->end) return 0;
    *value = (span){at + strlen(open), end};
    return 1;
}

/* The numbers of a matrix or of a list. */
static sf_status get_list(const storage *s, const char *key, double *values, size_t most, size_t *count) {
    *count = 0;
    if (s->root) {
        const json_t *value = json_object_get(s->root, key);
        if (json_is_object(value)) value = json_object_get(value, "data");
        if (json_is_array(value)) return add_items(s, key, value, values, most, count);
    } else {
        span value;
        if (!find(s, key, &value)) return missing(s, key);
        int in_data = s->is_xml ? narrow(&value, "<data>", "</data>") : narrow(&value, "data:", NULL);
        value.at += strspn(value.at, BLANKS);
        if (s->is_xml && (in_data || *value.at != '<')) return add_words(s, key, value, values, most, count);
        if (!s->is_xml && *value.at == '[') return add_flow(s, key, value, values, most, count);
    }
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: has no data: [...]", s->path, key);
}

/* Sizes. */

static sf_status take_side(const storage *s, const char *key, double value, int32_t *side) {
    if (!(value >= 1 && value <= MOST_SIDE && value == floor(value))) return bad_number(s, key);
    *side = (int32_t)value;
    return SF_OK;
}

static sf_status get_side(const storage *s, const char *key, int32_t *side) {
    char word[WORD], *end;
    if (!has(s, key))
        return sf_fail(s->ctx, SF_ERR_FORMAT,
                       "%s: %s: is missing: add image_width and image_height, the size in pixels of the "
                       "pictures that were calibrated",
                       s->path, key);
    get_word(s, key, word);
    double value = strtod(word, &end);
    return end == word || *end ? bad_number(s, key) : take_side(s, key, value, side);
}

static sf_status read_size(const storage *s, sf_calibration *c) {
    const char *key = first_of(s, size_keys);
    double sides[2];
    size_t count;
    if (!key || has(s, "image_width")) {
        sf_status status = get_side(s, "image_width", &c->width);
        return status ? status : get_side(s, "image_height", &c->height);
    }
    sf_status status = get_list(s, key, sides, 2, &count);
    if (status) return status;
    if (count != 2) return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is not [width, height]", s->path, key);
    status = take_side(s, key, sides[0], &c->width);
    return status ? status : take_side(s, key, sides[1], &c->height);
}

/* Lenses. */

static sf_status read_matrix(const storage *s, sf_lens *lens) {
    const char *key = first_of(s, matrix_keys);
    double m[9];
    size_t count;
    if (!key) return missing(s, matrix_keys[0]);
    sf_status status = get_list(s, key, m, 9, &count);
    if (status) return status;
    if (count != 9 || m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: is not [fx, 0, cx, 0, fy, cy, 0, 0, 1]", s->path, key);
    if (m[1] != 0)
        return sf_fail(s->ctx, SF_ERR_UNSUPPORTED, "%s: %s: skew: %g is not supported, only 0", s->path, key,
                       m[1]);
    lens->fx = m[0];
    lens->fy = m[4];
    lens->cx = m[2] + 0.5; /* OpenCV's first pixel has its middle at 0 */
    lens->cy = m[5] + 0.5;
    return SF_OK;
}

static sf_status read_distortion(const storage *s, sf_lens *lens) {
    static const char *const higher[] = {"k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"};
    enum { OURS = 5, MOST = 14 };
    const char *key = first_of(s, distortion_keys);
    double d[MOST] = {0};
    size_t count;
    if (!key) return missing(s, distortion_keys[0]);
    sf_status status = get_list(s, key, d, MOST, &count);
    if (status) return status;
    if (count != 4 && count != 5 && count != 8 && count != 12 && count != 14)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: %s: %zu numbers are not 4, 5, 8, 12 or 14", s->path, key,
                       count);
    for (size_t i = OURS; i < count; i++)
        if (fabs(d[i]) > 1e-9)
            return sf_fail(s->ctx, SF_ERR_UNSUPPORTED, "%s: %s: %s: %g is not supported, only 0", s->path,
                           key, higher[i - OURS], d[i]);
    lens->k1 = d[0];
    lens->k2 = d[1];
    lens->p1 = d[2];
    lens->p2 = d[3];
    lens->k3 = d[4];
    return SF_OK;
}

/* A fisheye's four coefficients are k1 to k4, which nothing but this key tells from k1, k2, p1, p2. */
static sf_status check_fisheye(const storage *s) {
    char word[WORD];
    get_word(s, "fisheye_model", word);
    if (!*word || !strcmp(word, "0") || !strcmp(word, "false")) return SF_OK;
    return sf_fail(s->ctx, SF_ERR_UNSUPPORTED,
                   "%s: fisheye_model: %s: the coefficients are k1 to k4 of OpenCV's fisheye, which is not "
                   "supported here: undistort the pictures first, or calibrate without the fisheye model",
                   s->path, word);
}

/* ROS names the model; plumb_bob is this one. */
static sf_status check_distortion_model(const storage *s) {
    char word[WORD];
    get_word(s, "distortion_model", word);
    if (!*word || !strcmp(word, "plumb_bob") || !strcmp(word, "rational_polynomial")) return SF_OK;
    return sf_fail(s->ctx, SF_ERR_UNSUPPORTED,
                   "%s: distortion_model: %s is not supported, only plumb_bob and rational_polynomial",
                   s->path, word);
}

static sf_status read_all(const storage *s, sf_calibration *c) {
    sf_status status = check_fisheye(s);
    if (!status) status = check_distortion_model(s);
    if (!status) status = read_size(s, c);
    if (!status) status = read_matrix(s, &c->lens);
    return status ? status : read_distortion(s, &c->lens);
}

int sf_opencv_is_text(const char *text) {
    const storage s = {.text = text};
    text += strspn(text, BLANKS);
    if (*text == '<') return strstr(text, "<opencv_storage") != NULL;
    return !strncmp(text, "%YAML", 5) || has(&s, "image_width") || first_of(&s, size_keys) ||
           first_of(&s, matrix_keys);
}

int sf_opencv_is_json(const json_t *root) {
    const storage s = {.root = root};
    return json_is_object(root) && !has(&s, "fx") && (has(&s, "image_width") || first_of(&s, matrix_keys));
}

/* Numbers have a point in every locale of the program. */
sf_status sf_opencv_read(sf_context *ctx, const char *path, const char *text, const json_t *root,
                         sf_calibration *c) {
    const storage s = {ctx, path, text, root, text && text[strspn(text, BLANKS)] == '<'};
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) return sf_fail(ctx, SF_ERR_MEMORY, "%s: out of memory", path);
    locale_t before = uselocale(plain);
    sf_status status = read_all(&s, c);
    uselocale(before);
    freelocale(plain);
    return status;
}
