/* query.h - the options in a source's name, as in the query of a URL: "sim:studio?width=320&frames=60". */
#ifndef SF_BASE_QUERY_H
#define SF_BASE_QUERY_H

#include "context.h"

/* An option "name=value": a number, or a text if `text` is not NULL. A name that ends in a dot accepts all
 * options that begin with it; the caller reads these itself. */
typedef struct sf_query_option {
    const char *name;
    double value; /* in: the default; out: the value in the name */
    double least, most;
    int whole;  /* no fraction */
    char *text; /* text_size bytes; in: the default; out: the value in the name */
    size_t text_size;
} sf_query_option;

/* Reads the options behind the '?' of `source` into the table; of an option named twice, the last counts.
 * SF_ERR_ARGUMENT: an option that is not in the table, not a number, out of range, too long a text. */
sf_status sf_query_parse(sf_context *ctx, const char *source, sf_query_option *options, size_t count);

#endif
