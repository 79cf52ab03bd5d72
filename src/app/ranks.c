/* ranks.c - see ranks.h. */
#define _POSIX_C_SOURCE 200809L /* nanosleep */
#include "ranks.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>

int app_has_ranks(const sf_context *ctx) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    return info.size > 1;
}

int app_is_first_rank(const sf_context *ctx) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    return info.rank == 0;
}

int app_join(const args *a, sf_context *ctx) {
    sf_cluster_info info;
    if (sf_cluster_join(ctx)) return app_fail(a, ctx);
    sf_cluster_get_info(ctx, &info);
    if (info.rank) args_speak_as(info.rank, info.host);
    return 0;
}

void app_sum_over_ranks(sf_context *ctx, double *values, int n) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    if (info.size == 1) return;
    double *all = malloc((size_t)(info.size * n) * sizeof *all);
    if (!all) return sf_cluster_abort(ctx, EXIT_FAILED);
    sf_cluster_gather(ctx, values, n, all);
    for (int k = 0; k < n; k++) {
        values[k] = 0;
        for (int r = 0; r < info.size; r++) values[k] += all[r * n + k];
    }
    free(all);
}

double app_most_of_ranks(sf_context *ctx, double value) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    double *all = malloc((size_t)info.size * sizeof *all), most = value;
    if (!all) sf_cluster_abort(ctx, EXIT_FAILED);
    if (all) sf_cluster_gather(ctx, &value, 1, all);
    for (int r = 0; all && r < info.size; r++) most = fmax(most, all[r]);
    free(all);
    return most;
}

int app_load_from(const args *a, sf_context *ctx, const char *path, sf_model **from, size_t *count) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    int error = app_load_part(a, ctx, path, info.rank, info.size, from);
    if (error) return error;
    double all = (double)sf_model_count(*from);
    app_sum_over_ranks(ctx, &all, 1);
    *count = (size_t)all;
    return *count ? 0 : app_say(a, path, "holds no Gaussian to go on from");
}

/* Whether rank 0's cameras are on this host, too; another host's files may be seen a little later. */
static int are_here(const args *a, const char *path, char **project) {
    enum { LOOKS = 20 };
    const struct timespec pause = {0, 250000000};
    for (int look = 0; look < LOOKS; look++) {
        if (app_cameras_were_found(a, path, project)) return 1;
        free(*project);
        *project = NULL;
        nanosleep(&pause, NULL);
    }
    return 0;
}

int app_find_cameras_once(const args *a, sf_context *ctx, int known, FILE *out, char **project) {
    const char *path = a->positional[0];
    int first = app_is_first_rank(ctx), error = 0;
    if (!(app_most_of_ranks(ctx, !known) > 0)) return 0;
    if (first && !known) error = app_find_cameras(a, ctx, path, out, project);
    error = (int)app_most_of_ranks(ctx, error);
    if (error || first || known || are_here(a, path, project)) return error;
    return app_say(a, path, "the cameras that rank 0 found are not on this host: copy the project here");
}

FILE *app_rank_out(const sf_context *ctx, FILE *out) {
    FILE *nowhere = app_is_first_rank(ctx) ? NULL : fopen("/dev/null", "w");
    return nowhere ? nowhere : out;
}

void app_print_ranks(sf_context *ctx, FILE *out, long long steps) {
    sf_cluster_info info;
    sf_cluster_get_info(ctx, &info);
    if (info.size == 1) return;
    const double mine[] = {app_peak_memory(), (double)info.sent, (double)info.rounds, (double)info.in_steps,
                           info.designed};
    enum { VALUES = sizeof mine / sizeof *mine };
    double *all = malloc((size_t)info.size * sizeof mine), n = steps ? (double)steps : 1;
    if (!all) return sf_cluster_abort(ctx, EXIT_FAILED);
    sf_cluster_gather(ctx, mine, VALUES, all);
    for (int r = 0; r < info.size; r++)
        fprintf(out, "rank %d: peak memory %.0f MB, sent %.1f MB, %.0f kB a step in %.1f exchanges\n", r,
                all[VALUES * r], all[VALUES * r + 1] / 1e6, all[VALUES * r + 1] / n / 1e3,
                all[VALUES * r + 2] / n);
    double sent = 0, designed = 0;
    for (int r = 0; r < info.size; r++) sent += all[VALUES * r + 3], designed += all[VALUES * r + 4];
    fprintf(out, "steps of all ranks: %.1f kB sent in each, %.1f designed, %+.1f %%\n", sent / n / 1e3,
            designed / n / 1e3, designed > 0 ? 100 * (sent / designed - 1) : 0);
    free(all);
}

int app_part(sf_context *ctx, int error) {
    if (!ctx) return error;
    if (error && error != EXIT_USAGE && error < 128) sf_cluster_abort(ctx, error);
    sf_cluster_leave(ctx);
    return error;
}
