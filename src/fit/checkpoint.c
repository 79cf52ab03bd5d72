/* checkpoint.c - what writing and reading a checkpoint share. */
#include "checkpoint.h"

#include <stdio.h>

const sf_sections_kind sf_checkpoint_kind = {
    .magic = "SPLATFIT", .version = 2, .text = "a checkpoint of splatfit"};

sf_checkpoint_field sf_checkpoint_name(const char *prefix, int field) {
#define NAME(name, components) #name,
    static const char *const names[] = {SF_FIELDS(NAME)};
#undef NAME
    sf_checkpoint_field n;
    snprintf(n.text, sizeof n.text, "%s.%s", prefix, names[field]);
    return n;
}

size_t sf_checkpoint_values(const sf_model *model, int field) {
    return sf_field_values(field, model->banded[sf_field_band(field)]);
}

size_t sf_checkpoint_moments(const sf_optimizer_state *moments, int part, const sf_model *model, int field) {
    size_t n = (size_t)sf_moment_components(moments, part, field);
    return n * SF_LANES * sf_blocks(model->banded[sf_field_band(field)]);
}

sf_status sf_checkpoint_bad(const sf_sections_in *in, const char *section, const char *what) {
    return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: %s", in->path, section, what);
}
