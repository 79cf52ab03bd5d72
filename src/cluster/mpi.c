/* mpi.c - ranks that are processes of MPI. The only file that sees MPI. */
#define _POSIX_C_SOURCE 200809L /* nanosleep */
#include "cluster.h"

#ifdef SF_HAVE_MPI

#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <mpi.h>

/* MPI counts in int. */
enum { MOST_BYTES = 1 << 30 };

/* Waits for all of them. MPI's own waiting keeps a processor busy, which a rank that works may need: beyond
 * a short while the processor is left to others between two looks. */
static void wait_all(MPI_Request *requests, int n) {
    enum { LOOKS = 2000, YIELDS = 200 };
    const struct timespec rest = {0, 50000};
    for (int k = 0; k < n; k++) {
        MPI_Status status; /* gcc takes MPICH's MPI_STATUSES_IGNORE for an array of none */
        int done = 0;
        for (int look = 0; !done; look++) {
            MPI_Test(requests + k, &done, &status);
            if (done || look < LOOKS) continue;
            if (look < LOOKS + YIELDS)
                sched_yield();
            else
                nanosleep(&rest, NULL);
        }
    }
}

static void gather(sf_cluster *c, const void *from, size_t bytes, void *to) {
    MPI_Request request;
    (void)c;
    MPI_Iallgather(from, (int)bytes, MPI_BYTE, to, (int)bytes, MPI_BYTE, MPI_COMM_WORLD, &request);
    wait_all(&request, 1);
}

/* Sends or receives n bytes, in the parts of a message of `most`; returns the number of requests. */
static int post(MPI_Request *requests, char *bytes, size_t n, size_t most, int rank, int sending) {
    int posted = 0;
    for (size_t done = 0; done < most; posted++) {
        size_t left = n > done ? n - done : 0, part = left < MOST_BYTES ? left : MOST_BYTES;
        if (sending)
            MPI_Isend(bytes + done, (int)part, MPI_BYTE, rank, 0, MPI_COMM_WORLD, requests + posted);
        else
            MPI_Irecv(bytes + done, (int)part, MPI_BYTE, rank, 0, MPI_COMM_WORLD, requests + posted);
        done += MOST_BYTES;
    }
    return posted;
}

static void exchange(sf_cluster *c, const sf_messages *m) {
    const size_t *send_most = m->send_most ? m->send_most : m->send_bytes;
    size_t parts = 0;
    for (int r = 0; r < c->size; r++) parts += 2 + (send_most[r] + m->receive_bytes[r]) / MOST_BYTES;
    MPI_Request *requests = sf_alloc(c->ctx, parts * (size_t)m->arrays, sizeof(MPI_Request));
    if (!requests) {
        sf_log(c->ctx, SF_LOG_WARNING, "out of memory");
        MPI_Abort(MPI_COMM_WORLD, 1);
        return;
    }
    int n = 0, me = c->rank;
    for (int k = 1; k < c->size;
         k++) { /* each begins with the rank after it, so that no rank gets all at once */
        int source = (me + c->size - k) % c->size;
        for (int a = 0; a < m->arrays; a++)
            n += post(requests + n, m->to[a] + m->receive_at[source], m->receive_bytes[source],
                      m->receive_bytes[source], source, 0);
    }
    for (int k = 1; k < c->size; k++) {
        int target = (me + k) % c->size;
        /* MPI takes what it sends as const; `post` is shared with receiving */
        for (int a = 0; a < m->arrays; a++)
            n += post(requests + n, (char *)(uintptr_t)(m->from[a] + m->send_at[target]),
                      m->send_bytes[target], send_most[target], target, 1);
    }
    for (int a = 0; a < m->arrays && m->send_bytes[me]; a++)
        memcpy(m->to[a] + m->receive_at[me], m->from[a] + m->send_at[me], m->send_bytes[me]);
    wait_all(requests, n);
    sf_free(c->ctx, requests);
}

static void end_all(const sf_cluster *c, int exit_code) {
    (void)c;
    MPI_Abort(MPI_COMM_WORLD, exit_code);
}

static void leave(sf_cluster *c) {
    (void)c;
    MPI_Finalize();
}

static const sf_cluster_ops mpi = {
    .gather = gather, .exchange = exchange, .end_all = end_all, .leave = leave};

sf_status sf_mpi_join(sf_context *ctx, int expected) {
    int level, rank, size;
    if (MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &level) != MPI_SUCCESS)
        return sf_fail(ctx, SF_ERR_UNSUPPORTED, "mpirun: MPI does not start");
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != expected) {
        char version[MPI_MAX_LIBRARY_VERSION_STRING];
        int length;
        MPI_Get_library_version(version, &length);
        MPI_Finalize();
        return sf_fail(
            ctx, SF_ERR_UNSUPPORTED,
            "mpirun: %d processes were started by another MPI than this splatfit is built with, %.*s",
            expected, (int)strcspn(version, ",\n"), version);
    }
    sf_status status = sf_cluster_create(ctx, &mpi, NULL, rank, size);
    if (status) MPI_Abort(MPI_COMM_WORLD, 1);
    return status;
}

#endif
