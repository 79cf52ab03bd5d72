/* source_fixture.h - simulated sources. */
#ifndef TESTS_UNIT_SOURCE_FIXTURE_H
#define TESTS_UNIT_SOURCE_FIXTURE_H

#include "testing.h"

#define TINY "sim:studio?width=32&height=24"

sf_source *source_open_source(sf_context *ctx, const char *name);

#endif
