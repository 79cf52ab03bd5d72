/* source_fixture.c - see the header. */
#include "source_fixture.h"

sf_source *source_open_source(sf_context *ctx, const char *name) {
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    assert_non_null(source);
    return source;
}
