/* colmap_text.c - see colmap_text.h. */
#include "colmap_text.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

typedef struct text {
    sf_colmap_reader *r;
    char *next; /* line */
    char *at;   /* in the line */
    unsigned long line;
} text;

/* 0 at the end. The line is cut at its end and loses the spaces there. */
static int next_line(text *t) {
    if (!*t->next) return 0;
    size_t length = strcspn(t->next, "\n");
    t->at = t->next;
    t->next += length + (t->next[length] == '\n');
    while (length && strchr(" \t\r", t->at[length - 1])) length--;
    t->at[length] = 0;
    t->at += strspn(t->at, " \t");
    t->line++;
    return 1;
}

static int next_record(text *t) {
    while (next_line(t))
        if (*t->at && *t->at != '#') return 1;
    return 0;
}

static char *next_word(text *t) {
    char *word = t->at;
    t->at += strcspn(t->at, " \t");
    if (*t->at) *t->at++ = 0;
    t->at += strspn(t->at, " \t");
    return word;
}

static sf_status bad_word(text *t, const char *field, const char *word) {
    return sf_fail(t->r->ctx, SF_ERR_FORMAT, "%s: line %lu: %s: '%s' is not a number in its range",
                   t->r->file, t->line, field, word);
}

static sf_status read_real(text *t, const char *field, double *value) {
    char *word = next_word(t), *end;
    *value = strtod(word, &end);
    return end == word || *end ? bad_word(t, field, word) : SF_OK;
}

static sf_status read_reals(text *t, const char *field, int count, double *values) {
    sf_status status = SF_OK;
    for (int i = 0; !status && i < count; i++) status = read_real(t, field, &values[i]);
    return status;
}

static sf_status read_integer(text *t, const char *field, uint64_t most, uint64_t *value) {
    char *word = next_word(t), *end;
    if (*word < '0' || *word > '9') return bad_word(t, field, word); /* strtoull takes signs */
    errno = 0;
    *value = strtoull(word, &end, 10);
    return *end || errno || *value > most ? bad_word(t, field, word) : SF_OK;
}

static sf_status read_id(text *t, const char *field, uint32_t *id) {
    uint64_t value = 0;
    sf_status status = read_integer(t, field, UINT32_MAX, &value);
    *id = (uint32_t)value;
    return status;
}

static sf_status read_model(text *t, sf_colmap_camera_record *record) {
    const char *name = next_word(t);
    record->model = sf_lens_model_named(name);
    if (record->model) return SF_OK;
    return sf_fail(t->r->ctx, SF_ERR_FORMAT, "%s: line %lu: model: '%s' is not known", t->r->file, t->line,
                   name);
}

static sf_status read_parameters(text *t, sf_colmap_camera_record *record) {
    if (record->model->layout)
        return read_reals(t, "parameters", (int)strlen(record->model->layout), record->parameters);
    double unread;
    sf_status status = SF_OK;
    for (int i = 0; !status && i < record->model->unread; i++) status = read_real(t, "parameters", &unread);
    return status;
}

static sf_status parse_camera(text *t) {
    sf_colmap_camera_record record = {0};
    sf_status status = read_id(t, "camera id", &record.id);
    if (!status) status = read_model(t, &record);
    if (!status) status = read_integer(t, "width", UINT64_MAX, &record.width);
    if (!status) status = read_integer(t, "height", UINT64_MAX, &record.height);
    if (!status) status = read_parameters(t, &record);
    if (!status && *t->at) status = bad_word(t, "end of line", t->at);
    return status ? status : sf_colmap_add_camera(t->r, &record);
}

sf_status sf_colmap_parse_cameras(sf_colmap_reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_camera(&t);
    return status;
}

static int is_number(const char *word) {
    char *end;
    strtod(word, &end);
    return end > word && !*end;
}

/* The line of observations is not used, but a line that is none, such as the next image's, shows that lines
 * are missing. */
static sf_status skip_observations(text *t) {
    size_t words = 0;
    const char *last = "0";
    if (!next_line(t)) return SF_OK;
    for (; *t->at; words++) last = next_word(t);
    if (words % 3 == 0 && is_number(last)) return SF_OK;
    return sf_fail(
        t->r->ctx, SF_ERR_FORMAT,
        "%s: line %lu: observations: %zu words are not x, y, id each: an image is two lines, of which "
        "the second may be empty",
        t->r->file, t->line, words);
}

static sf_status parse_image(text *t) {
    sf_colmap_image_record record;
    sf_status status = read_id(t, "image id", &record.id);
    if (!status) status = read_reals(t, "quaternion", 4, record.q);
    if (!status) status = read_reals(t, "translation", 3, record.t);
    if (!status) status = read_id(t, "camera id", &record.camera);
    record.name = t->at;
    if (!status) status = sf_colmap_add_image(t->r, &record);
    return status ? status : skip_observations(t);
}

sf_status sf_colmap_parse_images(sf_colmap_reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_image(&t);
    return status;
}

static sf_status parse_point(text *t) {
    sf_colmap_point_record record;
    uint64_t id, value = 0;
    sf_status status = read_integer(t, "point id", UINT64_MAX, &id);
    if (!status) status = read_reals(t, "position", 3, record.xyz);
    for (int i = 0; !status && i < 3; i++) {
        status = read_integer(t, "colour", 255, &value);
        record.rgb[i] = (uint8_t)value;
    }
    return status ? status : sf_colmap_add_point(t->r, &record);
}

sf_status sf_colmap_parse_points(sf_colmap_reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_point(&t);
    return status;
}

uint64_t sf_colmap_count_lines(char *data) {
    uint64_t count = 0;
    text t = {.next = data};
    while (next_record(&t)) {
        count++;
        next_line(&t);
    }
    return count;
}
