/* query.c - the options in a source's name, as in the query of a URL. */
#include "query.h"

#include <stdlib.h>
#include <string.h>

/* "ctrl." stands for ctrl.ANYTHING, which the caller reads. */
static int is_family(const sf_query_option *option) { return option->name[strlen(option->name) - 1] == '.'; }

static sf_query_option *find_option(sf_query_option *options, size_t count, const char *name, size_t length) {
    for (size_t i = 0; i < count; i++)
        if (strlen(options[i].name) == length && memcmp(options[i].name, name, length) == 0)
            return &options[i];
    for (size_t i = 0; i < count; i++)
        if (is_family(&options[i]) && strlen(options[i].name) < length &&
            memcmp(options[i].name, name, strlen(options[i].name)) == 0)
            return &options[i];
    return NULL;
}

/* Reads text up to `end` as a plain decimal number. */
static int parse_number(const char *text, const char *end, double *value) {
    char copy[32], *stop;
    size_t length = (size_t)(end - text);
    if (length == 0 || length >= sizeof copy || strspn(text, "0123456789.-") < length) return 0;
    memcpy(copy, text, length);
    copy[length] = 0;
    *value = strtod(copy, &stop);
    return *stop == 0;
}

static int in_range(const sf_query_option *option, double value) {
    return value >= option->least && value <= option->most &&
           !(option->whole && value != (double)(int64_t)value);
}

static sf_status take_text(sf_context *ctx, const char *source, const char *value, const char *end,
                           sf_query_option *option) {
    size_t length = (size_t)(end - value);
    if (length == 0 || length >= option->text_size)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%.*s\" is not a text of 1 to %zu letters", source,
                       option->name, (int)length, value, option->text_size - 1);
    memcpy(option->text, value, length);
    option->text[length] = 0;
    return SF_OK;
}

/* Reads one "name=value" that ends at `end`. */
static sf_status parse_option(sf_context *ctx, const char *source, const char *text, const char *end,
                              sf_query_option *options, size_t count) {
    size_t length = strcspn(text, "=&");
    sf_query_option *option = find_option(options, count, text, length);
    if (!option)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown option \"%.*s\"", source, (int)length, text);
    const char *value = text + length + (text[length] == '=');
    if (is_family(option)) return SF_OK;
    if (option->text) return take_text(ctx, source, value, end, option);
    double number;
    if (!parse_number(value, end, &number))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%.*s\" is not a number", source, option->name,
                       (int)(end - value), value);
    if (!in_range(option, number))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: %.*s is not a%s number from %.16g to %.16g", source,
                       option->name, (int)(end - value), value, option->whole ? " whole" : "", option->least,
                       option->most);
    option->value = number;
    return SF_OK;
}

sf_status sf_query_parse(sf_context *ctx, const char *source, sf_query_option *options, size_t count) {
    const char *text = strchr(source, '?');
    while (text && *text) {
        text++; /* over ? or & */
        const char *end = text + strcspn(text, "&");
        sf_status status = parse_option(ctx, source, text, end, options, count);
        if (status != SF_OK) return status;
        text = end;
    }
    return SF_OK;
}
