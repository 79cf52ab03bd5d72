/* degrees_fixture.c - see the header. */
#include "degrees_fixture.h"

#include <stdlib.h>
#include <string.h>

#include "reference/random.h"

enum { HEAD = 64 };

static void *meter_alloc(void *user, size_t size) {
    meter *m = user;
    if (m->left == 0) return NULL;
    if (m->left > 0) m->left--;
    char *block = malloc(HEAD + size);
    assert_non_null(block);
    memcpy(block, &size, sizeof size);
    m->live += size;
    if (m->live > m->peak) m->peak = m->live;
    return block + HEAD;
}

static void meter_free(void *user, void *block) {
    meter *m = user;
    size_t size;
    memcpy(&size, (char *)block - HEAD, sizeof size);
    m->live -= size;
    free((char *)block - HEAD);
}

sf_context *degrees_metered(meter *m) {
    sf_context *ctx;
    *m = (meter){.left = -1};
    sf_allocator allocator = {meter_alloc, meter_free, m};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    return ctx;
}

void degrees_assert_about(size_t bytes, size_t expected) {
    const size_t blocks = 32, added = 72 + 256; /* of each array, and the struct itself */
    assert_between(bytes, expected, expected + blocks * added);
}
