/* scale_fixture.h - models of one scene in two units of length. */
#ifndef TESTS_UNIT_SCALE_FIXTURE_H
#define TESTS_UNIT_SCALE_FIXTURE_H

#include "../testing.h"

/* All fields of two models, one 2^power times the other, are the same to the bit; but for log-scales, which
 * are rounded logarithms. */
void scale_assert_same(const sf_model *model, const sf_model *scaled, int power);

#endif
