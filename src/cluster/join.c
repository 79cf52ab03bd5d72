/* join.c - the public side: joins the processes that were started together. */
#include "cluster.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* How many processes a launcher says that it started; 1: none says so. Open MPI, then MPICH and what else
 * speaks PMI. */
static int started_together(void) {
    static const char *const names[] = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"};
    int most = 1;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const char *value = getenv(names[i]);
        int size = value ? atoi(value) : 1;
        if (size > most) most = size;
    }
    return most;
}

sf_status sf_cluster_join(sf_context *ctx) {
    int expected = started_together();
    if (expected < 2 || ctx->cluster) return SF_OK;
#ifdef SF_HAVE_MPI
    return sf_mpi_join(ctx, expected);
#else
    return sf_fail(ctx, SF_ERR_UNSUPPORTED,
                   "mpirun: %d processes were started, and this splatfit is built without MPI: build it with "
                   "make MPI=openmpi or MPI=mpich",
                   expected);
#endif
}

void sf_cluster_get_info(const sf_context *ctx, sf_cluster_info *info) {
    const sf_cluster *c = ctx->cluster;
    *info = (sf_cluster_info){.rank = c ? c->rank : 0,
                              .size = c ? c->size : 1,
                              .sent = c ? c->sent : 0,
                              .rounds = c ? c->rounds : 0,
                              .in_steps = c ? c->in_steps : 0,
                              .designed = c ? c->designed : 0};
    if (gethostname(info->host, sizeof info->host - 1)) strcpy(info->host, "?");
}

void sf_cluster_abort(const sf_context *ctx, int exit_code) {
    if (ctx->cluster) ctx->cluster->ops->end_all(ctx->cluster, exit_code);
}

void sf_cluster_gather(sf_context *ctx, const double *values, int count, double *all) {
    if (ctx->cluster)
        sf_cluster_gather_bytes(ctx->cluster, values, (size_t)count * sizeof *values, all);
    else
        memcpy(all, values, (size_t)count * sizeof *values);
}

void sf_cluster_leave(sf_context *ctx) {
    if (!ctx->cluster) return;
    ctx->cluster->ops->leave(ctx->cluster);
    sf_cluster_destroy(ctx);
}
