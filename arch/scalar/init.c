/* init.c - the scalar table. */
#include "scalar.h"

void sf_kernels_init_scalar(sf_kernels *kernels) {
    *kernels = (sf_kernels){
        .isa = "scalar",
        .project = sf_project_scalar,
        .spans = sf_spans_scalar,
        .blend = sf_blend_scalar,
        .blend_bwd = sf_blend_bwd_scalar,
        .loss = sf_loss_scalar,
        .loss_bwd = sf_loss_bwd_scalar,
        .project_bwd = sf_project_bwd_scalar,
        .adam = sf_adam_scalar,
        .unpack = sf_unpack_scalar,
    };
}
