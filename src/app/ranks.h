/* ranks.h - a command that mpirun started on several ranks: which of them says and writes what. */
#ifndef SF_APP_RANKS_H
#define SF_APP_RANKS_H

#include "app.h"

/* Joins the ranks. From here on ranks other than 0 say nothing but their own errors, with rank and host. 0 or
 * an exit code. */
int app_join(const args *a, sf_context *ctx);
/* Whether this is rank 0, which alone writes files; whether there are others. */
int app_is_first_rank(const sf_context *ctx);
int app_has_ranks(const sf_context *ctx);
/* The largest value of all ranks; replaces values by their sums over the ranks. All must call them. */
double app_most_of_ranks(sf_context *ctx, double value);
void app_sum_over_ranks(sf_context *ctx, double *values, int n);
/* Reads the model that a fit starts from, of several ranks each its part; *count: Gaussians of all. 0 or an
 * exit code, where there is none, too. */
int app_load_from(const args *a, sf_context *ctx, const char *path, sf_model **from, size_t *count);
/* Finds the cameras of photos or a video, once, where a rank says that they are not known; of several ranks
 * rank 0 does, and the others wait and look for what it wrote. *project, which the caller frees: as
 * app_find_cameras; NULL: the cameras were known. 0 or an exit code, the same on all where rank 0 fails. */
int app_find_cameras_once(const args *a, sf_context *ctx, int known, FILE *out, char **project);
/* Where people read: nowhere on ranks other than 0. */
FILE *app_rank_out(const sf_context *ctx, FILE *out);
/* Memory and bytes sent of each rank. All must call it. */
void app_print_ranks(sf_context *ctx, FILE *out, long long steps);
/* Leaves the ranks; where this one failed, ends all. ctx may be NULL. Returns error. */
int app_part(sf_context *ctx, int error);

#endif
