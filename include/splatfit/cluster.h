/* cluster.h - one fit on several processes or machines, over MPI.
 *
 * Every process ("rank") runs the same program: it creates a context, joins, reads the same scene and calls
 * the same functions of one fitter in the same order. The Gaussians of the fit are divided among the ranks.
 */
#ifndef SPLATFIT_CLUSTER_H
#define SPLATFIT_CLUSTER_H

#include <stdint.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The place of this process among those that fit together. */
typedef struct sf_cluster_info {
    int rank, size;    /* 0 and 1 where no cluster was joined */
    char host[64];     /* the name of this machine */
    uint64_t sent;     /* bytes that this rank has sent to other ranks */
    uint64_t rounds;   /* exchanges between the ranks so far */
    uint64_t in_steps; /* bytes of `sent` that belong to renders and gradients of steps */
    double designed; /* what in_steps should be by the formula of src/cluster/README.md, which holds for sums
                        over all ranks */
} sf_cluster_info;

/* Joins the processes that mpirun or a batch system started together, before any other object of the context
 * exists; once in a process. Where this process was started alone nothing happens, and the fit is that of a
 * library without MPI, to the byte. SF_ERR_UNSUPPORTED: several processes were started together, and the
 * library is built without MPI or with another one; SF_ERR_MEMORY.
 *
 * With several ranks, these calls must be made by all ranks in the same order: sf_fitter_create, _step, _run,
 * _render, _snapshot, _save_model, _save and _load of a fitter. sf_fitter_snapshot gives rank 0 the whole
 * model and the others an empty one; sf_fitter_save writes on rank 0 alone. A call that fails on one rank
 * leaves the others waiting: call sf_cluster_abort. */
SF_API sf_status sf_cluster_join(sf_context *context);

/* Where this process is. */
SF_API void sf_cluster_get_info(const sf_context *context, sf_cluster_info *info);

/* Ends the processes of all ranks at once, with this exit code. Returns where no cluster was joined. */
SF_API void sf_cluster_abort(const sf_context *context, int exit_code);

/* values[k] of each rank, in the order of the ranks: all[size][count]. All ranks must call it. */
SF_API void sf_cluster_gather(sf_context *context, const double *values, int count, double *all);

/* Leaves the cluster; waits for the other ranks. Nothing happens where none was joined. sf_context_destroy
 * does not do this. */
SF_API void sf_cluster_leave(sf_context *context);

#ifdef __cplusplus
}
#endif
#endif
