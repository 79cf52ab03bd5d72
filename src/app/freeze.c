/* freeze.c - fit --freeze: the options of a fit whose steps do all of a step's work and change nothing. */
#include "app.h"

/* By name, so that what each is appears in the log and --replay repeats the run. */
static const char *const frozen[][2] = {
    /* rates of all that is learned */
    {"lr_mean", "0"},
    {"lr_sh0", "0"},
    {"lr_sh_rest", "0"},
    {"lr_opacity", "0"},
    {"lr_scale", "0"},
    {"lr_quat", "0"},
    {"lr_background", "0"},
    {"reg_opacity", "0"},
    {"reg_scale", "0"},
    /* nothing is added, removed, merged, relocated or limited */
    {"size", "cap"},
    {"densify", "gradient"},
    {"densify_every", "100000000"},
    {"densify_end", "1e-12"},
    {"densify_per_step", "0"},
    {"max_scale", "0"},
    {"max_aspect", "0"},
    /* all views count alike, and no step is left out */
    {"validate", "0"},
    {"target_psnr", "0"},
    {"blur", "0"},
    {"ema_steps", "0"},
    /* the degree is the model's */
    {"sh_degree", "0"},
};

int app_freeze(const args *a, sf_context *ctx, sf_model *from, size_t count, sf_fit_options *o) {
    static const char *const against[] = {"resume", "replay"};
    if (!args_value(a, "freeze")) return 0;
    for (int i = 0; i < 2; i++)
        if (args_value(a, against[i])) {
            args_error(a->command, "--freeze: cannot be given beside --%s", against[i]);
            return EXIT_USAGE;
        }
    if (!from) {
        args_error(a->command, "--freeze: needs the model that stays as it is: --from MODEL");
        return EXIT_USAGE;
    }
    if (o->exposure || o->refine_poses || o->refine_intrinsics) {
        args_error(a->command, "--freeze: cannot be given beside --%s, which learns",
                   o->exposure       ? "exposure"
                   : o->refine_poses ? "refine-poses"
                                     : "refine-intrinsics");
        return EXIT_USAGE;
    }
    for (size_t i = 0; i < sizeof frozen / sizeof *frozen; i++)
        if (sf_fit_options_set(ctx, o, frozen[i][0], frozen[i][1])) return app_fail(a, ctx);
    if (!args_value(a, "max_gaussians")) o->max_gaussians = (int64_t)(count ? count : 1);
    /* A step costs what the model's own bands cost, not those that its file is padded with. */
    return sf_model_pack(from) ? app_fail(a, ctx) : 0;
}
