/* y4m.c - the header of a YUV4MPEG2 stream. */
#include "y4m.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format.h"

typedef struct colour {
    const char *name;
    sf_pixel_format format;
} colour;

/* Names that begin with 420 tell where the chroma samples lie, which is left aside. */
static const colour colours[] = {
    {"420jpeg", SF_PIXEL_YU12}, {"420mpeg2", SF_PIXEL_YU12}, {"420paldv", SF_PIXEL_YU12},
    {"420", SF_PIXEL_YU12},     {"422", SF_PIXEL_422P},      {"444", SF_PIXEL_444P},
    {"mono", SF_PIXEL_GREY},
};

typedef struct reader {
    sf_y4m *header;
    char *fault;
    size_t room;
} reader;

static sf_status refuse(const reader *r, sf_status status, const char *field, const char *value,
                        const char *why) {
    snprintf(r->fault, r->room, "YUV4MPEG2: %s: \"%.40s\" %s", field, value, why);
    return status;
}

static sf_status parse_side(const reader *r, const char *field, const char *text, int32_t *side) {
    char *end;
    long value = *text >= '0' && *text <= '9' ? strtol(text, &end, 10) : 0;
    if (value < 1 || value > SF_FRAME_MAX_SIDE || *end)
        return refuse(r, SF_ERR_FORMAT, field, text, "is not a whole number from 1 to 65535");
    *side = (int32_t)value;
    return SF_OK;
}

/* "30000:1001"; 0:0 is unknown. */
static sf_status parse_rate(const reader *r, const char *text) {
    char *end;
    long n = strtol(text, &end, 10), d = *end == ':' ? strtol(end + 1, &end, 10) : -1;
    if (n < 0 || d < 0 || *end || end == text) return refuse(r, SF_ERR_FORMAT, "rate", text, "is not N:D");
    r->header->fps = n && d ? (double)n / (double)d : 0;
    return SF_OK;
}

static sf_status parse_interlacing(const reader *r, const char *text) {
    if (!strcmp(text, "p") || !strcmp(text, "?")) return SF_OK;
    if (strlen(text) == 1 && strchr("tbm", *text))
        return refuse(r, SF_ERR_UNSUPPORTED, "interlacing", text, "is not supported, only p");
    return refuse(r, SF_ERR_FORMAT, "interlacing", text, "is none of p, t, b, m, ?");
}

static sf_status parse_colour(const reader *r, const char *text) {
    for (size_t i = 0; i < sizeof colours / sizeof *colours; i++)
        if (!strcmp(text, colours[i].name)) {
            r->header->format = colours[i].format;
            return SF_OK;
        }
    return refuse(r, SF_ERR_UNSUPPORTED, "colour space", text,
                  "is none of 420jpeg, 420mpeg2, 420paldv, 420, 422, 444, mono");
}

static sf_status parse_extension(const reader *r, const char *text) {
    static const char range[] = "COLORRANGE=";
    if (strncmp(text, range, strlen(range)) != 0) return SF_OK;
    text += strlen(range);
    r->header->full_range = !strcmp(text, "FULL");
    if (r->header->full_range || !strcmp(text, "LIMITED")) return SF_OK;
    return refuse(r, SF_ERR_FORMAT, "XCOLORRANGE", text, "is neither FULL nor LIMITED");
}

static sf_status parse_word(const reader *r, const char *word) {
    const char *value = word + 1;
    switch (word[0]) {
    case 'W':
        return parse_side(r, "width", value, &r->header->width);
    case 'H':
        return parse_side(r, "height", value, &r->header->height);
    case 'F':
        return parse_rate(r, value);
    case 'I':
        return parse_interlacing(r, value);
    case 'C':
        return parse_colour(r, value);
    case 'X':
        return parse_extension(r, value);
    case 'A': /* the shape of a pixel: focal lengths say it */
        return SF_OK;
    default:
        return refuse(r, SF_ERR_FORMAT, "header", word, "is no parameter");
    }
}

sf_status sf_y4m_parse(char *line, sf_y4m *header, char *fault, size_t room) {
    reader r = {header, fault, room};
    *header = (sf_y4m){.format = SF_PIXEL_YU12};
    char *rest = line + strlen(SF_Y4M_MAGIC);
    sf_status status = SF_OK;
    while (status == SF_OK && *rest) {
        char *word = rest;
        rest += strcspn(rest, " ");
        if (*rest) *rest++ = 0;
        if (*word) status = parse_word(&r, word);
    }
    if (status != SF_OK) return status;
    if (!header->width || !header->height)
        return refuse(&r, SF_ERR_FORMAT, header->width ? "height" : "width", "", "is missing");
    if ((int64_t)header->width * header->height <= SF_FRAME_MAX_PIXELS) return SF_OK;
    snprintf(fault, room, "YUV4MPEG2: size: %d x %d is more than %d pixels", (int)header->width,
             (int)header->height, SF_FRAME_MAX_PIXELS);
    return SF_ERR_UNSUPPORTED;
}
