/* row_flags.c - row 24: a build with -ffast-math. */
#include <stdio.h>
#include <stdlib.h>

#include "stability.h"

/* Reads the words that the script prints; 0 where it failed. */
static int read_outcome(int *refused, int *noticed, int *programs) {
    FILE *out = popen("tests/stability/fast_math.sh build/fast-math", "r");
    if (!out) return 0;
    int words = fscanf(out, "refused %d noticed %d of %d", refused, noticed, programs);
    return pclose(out) == 0 && words == 3;
}

static void flags(stab_run *run) {
    int refused = 0, noticed = 0, programs = 0;
    if (getenv("RUN") && *getenv("RUN")) {
        stab_skip(run, "this is built for another machine");
        return;
    }
    int ran = read_outcome(&refused, &noticed, &programs);
    stab_at_least(run, ran, 1, "", "build/fast-math was built and run: see build/fast-math.log");
    if (!ran) return;
    stab_at_least(run, refused, 1, "", "a build with -ffast-math is refused");
    stab_at_least(run, noticed, 1, "programs",
                  "of %d programs of the check, those that notice it in a build forced to it", programs);
}

const stab_row stab_row_24 = {
    .id = "24",
    .failure = "Compiler flags that change arithmetic: -ffast-math folds a rounding constant silently",
    .cure = "The headers refuse it, lint looks for it, and the check against float64 notices it where it is "
            "forced.",
    .run = flags,
};
