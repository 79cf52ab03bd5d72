/* ply.c - see ply.h. */
#include "ply.h"

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"
#include "../base/memory.h"
#include "ply_header.h"
#include "window.h"

typedef enum format { FORMAT_UNKNOWN, FORMAT_ASCII, FORMAT_LITTLE_ENDIAN, FORMAT_BIG_ENDIAN } format;

typedef enum type {
    TYPE_INT8,
    TYPE_UINT8,
    TYPE_INT16,
    TYPE_UINT16,
    TYPE_INT32,
    TYPE_UINT32,
    TYPE_FLOAT,
    TYPE_DOUBLE
} type;

/* By type: the name of the format's paper, the one of newer tools, and the bytes of a value. */
static const struct {
    const char *name, *new_name;
    size_t size;
} types[] = {
    {"char", "int8", 1}, {"uchar", "uint8", 1}, {"short", "int16", 2},   {"ushort", "uint16", 2},
    {"int", "int32", 4}, {"uint", "uint32", 4}, {"float", "float32", 4}, {"double", "float64", 8},
};

enum {
    MAX_ELEMENTS = 16,
    MAX_PROPERTIES = 512,
    MAX_WORDS = 5, /* of a line of the header: "property list uchar int vertex_indices" */
    UNUSED = -1    /* a property whose values go nowhere */
};

static const uint64_t max_file_size = (uint64_t)1 << 40;

typedef struct property {
    const char *name;
    type type; /* of a list: of its entries */
    int is_list;
    type length_type; /* of a list */
    int target;       /* which of the reader's values it gives, or UNUSED */
} property;

typedef struct element {
    const char *name;
    uint32_t count;
    size_t first, properties; /* in ply.properties */
} element;

/* A file and where its reading stands: text in memory, binary rows as they are read, behind the header in
 * memory. Names point into the header, which is cut into words. */
struct sf_ply {
    sf_context *ctx;
    const char *path;
    uint8_t *data;
    size_t size, at; /* of the file; in it */
    sf_window rows;  /* of a binary file */
    size_t body;     /* where the first element's rows begin */
    size_t line;     /* of the header, from 1 */
    format format;
    int antialiased;
    double origin[3];
    element elements[MAX_ELEMENTS];
    size_t element_count;
    property properties[MAX_PROPERTIES];
    size_t property_count;
    const element *in;    /* what is being read */
    uint32_t row;         /* of it */
    locale_t number_form; /* a decimal point, whatever the program's locale */
};

/* ---- Header ---- */

static sf_status parse_type(sf_ply *p, const char *word, type *found) {
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        if (strcmp(word, types[i].name) && strcmp(word, types[i].new_name)) continue;
        *found = (type)i;
        return SF_OK;
    }
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: type '%.40s' is none of .ply's", p->path, p->line,
                   word);
}

static sf_status parse_format(sf_ply *p, char **words, int count) {
    static const char *const names[] = {"", "ascii", "binary_little_endian", "binary_big_endian"};
    if (count != 3 || strcmp(words[2], "1.0"))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: format is not of version 1.0", p->path, p->line);
    for (int i = FORMAT_ASCII; i <= FORMAT_BIG_ENDIAN; i++)
        if (!strcmp(words[1], names[i])) p->format = (format)i;
    if (p->format) return SF_OK;
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: format '%.40s' is unknown", p->path, p->line,
                   words[1]);
}

static sf_status parse_count(sf_ply *p, const char *name, const char *word, uint32_t *count) {
    uint64_t n = 0;
    int digits = 0;
    while (word[digits] >= '0' && word[digits] <= '9' && n <= INT32_MAX)
        n = 10 * n + (uint64_t)(word[digits++] - '0');
    if (!digits || word[digits] || n > INT32_MAX)
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: element %.40s: count '%.40s' is not a number from 0 to %d",
                       p->path, name, word, INT32_MAX);
    *count = (uint32_t)n;
    return SF_OK;
}

static sf_status parse_element(sf_ply *p, char **words, int count) {
    if (count != 3)
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: element without a name and a count", p->path,
                       p->line);
    if (p->element_count == MAX_ELEMENTS)
        return sf_fail(p->ctx, SF_ERR_UNSUPPORTED, "%s: element %.40s: more than %d elements", p->path,
                       words[1], MAX_ELEMENTS);
    for (size_t i = 0; i < p->element_count; i++)
        if (!strcmp(p->elements[i].name, words[1]))
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: element %.40s: given twice", p->path, words[1]);
    element *e = &p->elements[p->element_count++];
    *e = (element){.name = words[1], .first = p->property_count};
    return parse_count(p, words[1], words[2], &e->count);
}

static sf_status check_property(sf_ply *p, const element *e, const property *q) {
    if (q->is_list && q->length_type >= TYPE_FLOAT)
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: property %.40s: its length is of type %s", p->path,
                       q->name, types[q->length_type].name);
    for (const property *other = p->properties + e->first; other < q; other++)
        if (!strcmp(other->name, q->name))
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: property %.40s: given twice", p->path, q->name);
    return SF_OK;
}

static sf_status parse_property(sf_ply *p, char **words, int count) {
    int is_list = count > 1 && !strcmp(words[1], "list");
    if (!p->element_count || count != (is_list ? 5 : 3))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: property without %s", p->path, p->line,
                       p->element_count ? "a type and a name" : "an element");
    if (p->property_count == MAX_PROPERTIES)
        return sf_fail(p->ctx, SF_ERR_UNSUPPORTED, "%s: property %.40s: more than %d properties", p->path,
                       words[count - 1], MAX_PROPERTIES);
    element *e = &p->elements[p->element_count - 1];
    property *q = &p->properties[p->property_count];
    *q = (property){.name = words[count - 1], .is_list = is_list, .target = UNUSED};
    sf_status status = parse_type(p, words[count - 2], &q->type);
    if (!status && is_list) status = parse_type(p, words[2], &q->length_type);
    if (!status) status = check_property(p, e, q);
    p->property_count++;
    e->properties++;
    return status;
}

/* Cuts the next line into its first words; returns how many there are, or -1 where no further line ends. */
static int next_line(sf_ply *p, char **words) {
    char *c = (char *)p->data + p->at;
    char *end = memchr(c, '\n', p->size - p->at);
    if (!end) return -1;
    *end = 0;
    p->at = (size_t)(end - (char *)p->data) + 1;
    p->line++;
    int count = 0;
    for (c += strspn(c, " \t\r"); *c && count < MAX_WORDS; c += strspn(c, " \t\r")) {
        words[count++] = c;
        c += strcspn(c, " \t\r");
        if (*c) *c++ = 0;
    }
    return count;
}

static sf_status parse_origin(sf_ply *p, char **words) {
    for (int k = 0; k < 3; k++) {
        char *end;
        p->origin[k] = strtod(words[k], &end);
        if (*end || !isfinite(p->origin[k]))
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: comment origin: %.40s is not a number",
                           p->path, p->line, words[k]);
    }
    return SF_OK;
}

static sf_status parse_line(sf_ply *p, char **words, int count) {
    if (!strcmp(words[0], "format")) return parse_format(p, words, count);
    if (!strcmp(words[0], "element")) return parse_element(p, words, count);
    if (!strcmp(words[0], "property")) return parse_property(p, words, count);
    if (!strcmp(words[0], "obj_info")) return SF_OK;
    if (!strcmp(words[0], "comment")) {
        if (count == 3 && !strcmp(words[1], "SplatRenderMode:") && !strcmp(words[2], "mip"))
            p->antialiased = 1;
        return count == 5 && !strcmp(words[1], "origin") ? parse_origin(p, words + 2) : SF_OK;
    }
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: line %zu: '%.40s' is no word of a .ply header", p->path,
                   p->line, words[0]);
}

static sf_status parse_header(sf_ply *p) {
    char *words[MAX_WORDS];
    int count = next_line(p, words);
    if (count != 1 || strcmp(words[0], "ply"))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: not a .ply file: its first line is not 'ply'", p->path);
    while ((count = next_line(p, words)) >= 0) {
        if (count && !strcmp(words[0], "end_header")) {
            if (p->format) return SF_OK;
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: header: the format line is missing", p->path);
        }
        sf_status status = count ? parse_line(p, words, count) : SF_OK;
        if (status) return status;
    }
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: header: end_header is missing", p->path);
}

/* ---- Values ---- */

static inline uint64_t bits(const uint8_t *data, int size, int big_endian) {
    uint64_t v = 0;
    for (int i = 0; i < size; i++) v |= (uint64_t)data[big_endian ? size - 1 - i : i] << (8 * i);
    return v;
}

static inline double decode(const uint8_t *data, type t, int big_endian) {
    uint32_t u;
    uint64_t w;
    float f;
    double d;
    switch (t) {
    case TYPE_INT8:
        return (int8_t)data[0];
    case TYPE_UINT8:
        return data[0];
    case TYPE_INT16:
        return (int16_t)bits(data, 2, big_endian);
    case TYPE_UINT16:
        return (double)bits(data, 2, big_endian);
    case TYPE_INT32:
        return (int32_t)bits(data, 4, big_endian);
    case TYPE_UINT32:
        return (double)bits(data, 4, big_endian);
    case TYPE_FLOAT:
        u = (uint32_t)bits(data, 4, big_endian);
        memcpy(&f, &u, sizeof f);
        return f;
    case TYPE_DOUBLE:
        w = bits(data, 8, big_endian);
        memcpy(&d, &w, sizeof d);
        return d;
    }
    return 0;
}

static sf_status fail_at_end(const sf_ply *p, const property *q) {
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: truncated: ends before property %.40s of %.40s %u of %u",
                   p->path, q->name, p->in->name, p->row, p->in->count);
}

static int is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

static void skip_blanks(sf_ply *p) {
    while (p->at < p->size && is_blank((char)p->data[p->at])) p->at++;
}

/* sf_read_file puts a 0 behind the data: no number reads past it. */
static sf_status next_number(sf_ply *p, const property *q, double *value) {
    skip_blanks(p);
    if (p->at == p->size) return fail_at_end(p, q);
    const char *text = (const char *)p->data + p->at;
    char *end;
    locale_t callers = uselocale(p->number_form);
    *value = strtod(text, &end);
    uselocale(callers);
    p->at += (size_t)(end - text);
    if (end > text && (p->at == p->size || is_blank(*end))) return SF_OK;
    size_t length = strcspn(text, " \t\r\n");
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: %.40s %u: property %.40s: '%.*s' is not a number", p->path,
                   p->in->name, p->row, q->name, length < 40 ? (int)length : 40, text);
}

static sf_status next_value(sf_ply *p, const property *q, type t, double *value) {
    if (p->format == FORMAT_ASCII) return next_number(p, q, value);
    const uint8_t *bytes = sf_window_at(&p->rows, p->at, types[t].size);
    if (!bytes) return fail_at_end(p, q);
    *value = decode(bytes, t, p->format == FORMAT_BIG_ENDIAN);
    p->at += types[t].size;
    return SF_OK;
}

/* ---- Rows ---- */

static const property *first_list(const sf_ply *p, const element *e) {
    for (size_t i = 0; i < e->properties; i++)
        if (p->properties[e->first + i].is_list) return &p->properties[e->first + i];
    return NULL;
}

/* Rows of a known size, of which all must be in the file; in text a value takes two bytes at least, its
 * separator included, which the last one may lack. */
static sf_status check_rows(const sf_ply *p, const element *e, uint64_t *bytes) {
    uint64_t row = 0, left = p->size - p->at;
    for (size_t i = 0; i < e->properties; i++)
        row += p->format == FORMAT_ASCII ? 2 : types[p->properties[e->first + i].type].size;
    if (p->format == FORMAT_ASCII) left++;
    *bytes = row * e->count;
    if (*bytes <= left) return SF_OK;
    return sf_fail(
        p->ctx, SF_ERR_FORMAT, "%s: truncated: %s%llu bytes are missing for element %.40s, count %u", p->path,
        p->format == FORMAT_ASCII ? "at least " : "", (unsigned long long)(*bytes - left), e->name, e->count);
}

static sf_status skip_list(sf_ply *p, const property *q) {
    double length, ignored;
    sf_status status = next_value(p, q, q->length_type, &length);
    if (status) return status;
    if (!(length >= 0 && length <= UINT32_MAX))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: %.40s %u: property %.40s: length %g", p->path, p->in->name,
                       p->row, q->name, length);
    for (double i = 0; i < length && !status; i++) status = next_value(p, q, q->type, &ignored);
    return status;
}

static sf_status skip_row(sf_ply *p) {
    sf_status status = SF_OK;
    double ignored;
    for (size_t i = 0; i < p->in->properties && !status; i++) {
        const property *q = &p->properties[p->in->first + i];
        status = q->is_list ? skip_list(p, q) : next_value(p, q, q->type, &ignored);
    }
    return status;
}

static sf_status skip_element(sf_ply *p, const element *e) {
    sf_status status = SF_OK;
    p->in = e;
    if (!e->properties) return SF_OK; /* rows of nothing: do not walk them */
    if (p->format != FORMAT_ASCII && !first_list(p, e)) {
        uint64_t bytes;
        status = check_rows(p, e, &bytes);
        if (!status) p->at += (size_t)bytes;
        return status;
    }
    for (p->row = 0; p->row < e->count && !status; p->row++) status = skip_row(p);
    return status;
}

static const element *find_element(const sf_ply *p, const char *name) {
    for (size_t i = 0; i < p->element_count; i++)
        if (!strcmp(p->elements[i].name, name)) return &p->elements[i];
    return NULL;
}

int sf_ply_has(const sf_ply *p, const char *name) { return find_element(p, name) != NULL; }

sf_status sf_ply_enter(sf_ply *p, const char *name) {
    const element *wanted = find_element(p, name);
    if (!wanted) return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: element %s is missing", p->path, name);
    p->at = p->body;
    for (const element *e = p->elements; e < wanted; e++) {
        sf_status status = skip_element(p, e);
        if (status) return status;
    }
    const property *list = first_list(p, wanted);
    if (list)
        return sf_fail(p->ctx, SF_ERR_UNSUPPORTED, "%s: element %s: property %.40s is a list", p->path, name,
                       list->name);
    p->in = wanted;
    p->row = 0;
    uint64_t bytes;
    return check_rows(p, wanted, &bytes);
}

void sf_ply_close(sf_ply **ply) {
    sf_ply *p = *ply;
    if (!p) return;
    if (p->number_form) freelocale(p->number_form);
    sf_window_close(&p->rows);
    sf_free(p->ctx, p->data);
    sf_free(p->ctx, p);
    *ply = NULL;
}

/* Of a binary file the header, of text all. */
static sf_status read_in(sf_ply *p) {
    p->data = sf_alloc(p->ctx, SF_PLY_HEADER_MOST + 1, 1);
    if (!p->data) return SF_ERR_MEMORY;
    p->size = sf_ply_binary_header(p->path, p->data);
    if (p->size) return SF_OK;
    sf_free(p->ctx, p->data);
    p->data = NULL;
    return sf_read_file(p->ctx, p->path, max_file_size, &p->data, &p->size);
}

static sf_status open_rows(sf_ply *p) {
    p->body = p->at;
    if (p->format == FORMAT_ASCII) return SF_OK;
    sf_status status = sf_window_open(&p->rows, p->ctx, p->path);
    p->size = (size_t)p->rows.size;
    return status;
}

sf_status sf_ply_open(sf_context *ctx, const char *path, sf_ply **ply) {
    sf_ply *p = *ply = sf_calloc(ctx, 1, sizeof *p);
    if (!p) return SF_ERR_MEMORY;
    p->ctx = ctx;
    p->path = path;
    p->number_form = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    sf_status status = SF_OK;
    if (!p->number_form) status = sf_fail(ctx, SF_ERR_MEMORY, "%s: no memory for a locale", path);
    p->rows.ctx = ctx, p->rows.fd = -1;
    if (!status) status = read_in(p);
    if (!status) status = parse_header(p);
    if (!status) status = open_rows(p);
    if (status) sf_ply_close(ply);
    return status;
}

size_t sf_ply_rows(const sf_ply *p) { return p->in->count; }
int sf_ply_antialiased(const sf_ply *p) { return p->antialiased; }
const double *sf_ply_origin(const sf_ply *p) { return p->origin; }

size_t sf_ply_properties(const sf_ply *p, const char *prefix) {
    size_t count = 0;
    for (size_t i = 0; i < p->in->properties; i++)
        count += !strncmp(p->properties[p->in->first + i].name, prefix, strlen(prefix));
    return count;
}

static property *find_property(sf_ply *p, const char *name) {
    for (size_t i = 0; i < p->in->properties; i++) {
        property *q = &p->properties[p->in->first + i];
        if (!strcmp(q->name, name)) return q;
    }
    return NULL;
}

int sf_ply_is_byte(sf_ply *p, const char *name) {
    const property *q = find_property(p, name);
    return q && q->type == TYPE_UINT8;
}
sf_status sf_ply_bind(sf_ply *p, const char *name, int target) {
    property *q = find_property(p, name);
    if (!q)
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: element %.40s: property %s is missing", p->path,
                       p->in->name, name);
    q->target = target;
    return SF_OK;
}

/* The conversion of what a float cannot hold is undefined: it becomes infinite. */
static float to_float(double v) {
    if (isnan(v)) return NAN;
    return fabs(v) <= FLT_MAX ? (float)v : copysignf(INFINITY, v > 0 ? 1.0f : -1.0f);
}

static sf_status to_word(const sf_ply *p, const property *q, double value, uint32_t *word) {
    if (!(value >= 0 && value <= UINT32_MAX))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: %.40s %u: property %.40s: %g is not in 0..4294967295",
                       p->path, p->in->name, p->row, q->name, value);
    *word = (uint32_t)value;
    return SF_OK;
}

/* Two of floats, doubles and words are NULL. */
static sf_status next_row(sf_ply *p, float *floats, double *doubles, uint32_t *words) {
    const property *q = p->properties + p->in->first, *end = q + p->in->properties;
    for (; q < end; q++) {
        double value;
        sf_status status = next_value(p, q, q->type, &value);
        if (!status && q->target != UNUSED) {
            if (floats)
                floats[q->target] = to_float(value);
            else if (doubles)
                doubles[q->target] = value;
            else
                status = to_word(p, q, value, &words[q->target]);
        }
        if (status) return status;
    }
    p->row++;
    return SF_OK;
}

sf_status sf_ply_next(sf_ply *p, float *values) { return next_row(p, values, NULL, NULL); }
sf_status sf_ply_next_doubles(sf_ply *p, double *values) { return next_row(p, NULL, values, NULL); }
sf_status sf_ply_next_words(sf_ply *p, uint32_t *words) { return next_row(p, NULL, NULL, words); }

void sf_ply_report_rest(sf_ply *p) {
    if (p->in != &p->elements[p->element_count - 1]) return;
    if (p->format == FORMAT_ASCII) skip_blanks(p);
    if (p->at < p->size)
        sf_log(p->ctx, SF_LOG_WARNING, "%s: %zu bytes after the last %.40s are ignored", p->path,
               p->size - p->at, p->in->name);
}
