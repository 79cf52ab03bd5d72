/* scale_fixture.c - see the header. */
#include "scale_fixture.h"

#include <math.h>

#include "scene/gaussians.h"

void scale_assert_same(const sf_model *model, const sf_model *scaled, int power) {
    assert_int_equal(scaled->count, model->count);
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, model->sh_degree); field++)
        for (size_t i = 0; i < model->banded[sf_field_band(field)]; i++)
            for (int c = 0; c < sf_field_components(field); c++) {
                float one = *sf_value(&model->params, field, i, c);
                float other = *sf_value(&scaled->params, field, i, c);
                if (field == SF_FIELD_mean)
                    assert_true(ldexpf(one, power) == other);
                else if (field == SF_FIELD_log_scale)
                    assert_true(fabs((double)one + power * log(2) - (double)other) < 4e-6);
                else
                    assert_true(one == other);
            }
}
