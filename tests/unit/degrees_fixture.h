/* degrees_fixture.h - models of several SH degrees. */
#ifndef TESTS_UNIT_DEGREES_FIXTURE_H
#define TESTS_UNIT_DEGREES_FIXTURE_H

#include "testing.h"

#include "reference/random.h"

/* What is allocated: each block is preceded by its size. */
typedef struct meter {
    size_t live, peak;
    long left; /* calls that still succeed; below 0: all */
} meter;

sf_context *degrees_metered(meter *m);
void degrees_assert_about(size_t bytes, size_t expected);

#endif
