/* ranks_save.c - writes the model of all ranks without gathering it: rows of the file go to rank 0, a few
 * thousand at a time. They stand as in a gathered model: by falling degree, those of a degree in the order of
 * the ranks. */
#include <string.h>

#include "../cluster/cluster.h"
#include "../io/model_ply.h"
#include "ranks.h"

enum { ROWS = 4096 /* that travel together */ };

typedef struct save_job {
    sf_cluster *cluster;
    const sf_model *part;
    const uint64_t *banded; /* [ranks][SF_BANDS] */
    int sh_degree;          /* of the file */
    sf_writer writer;       /* rank 0's */
    uint8_t *rows;          /* [ROWS] */
    size_t *counts;         /* [2 ranks] */
} save_job;

/* Whether a rank has failed. */
static int any_failed(const sf_fitter *f, sf_status status) {
    return sf_most_of_ranks(f, status != SF_OK) > 0;
}

/* `count` rows of one rank, from Gaussian `first` of its part on. */
static sf_status send_rows(save_job *j, size_t rank, size_t first, size_t count) {
    size_t n = (size_t)j->cluster->size, me = (size_t)j->cluster->rank,
           bytes = sf_ply_row_bytes(j->sh_degree);
    sf_status status = rank == me ? sf_ply_encode(j->part, first, count, j->sh_degree, j->rows) : SF_OK;
    if (rank) {
        memset(j->counts, 0, 2 * n * sizeof *j->counts);
        j->counts[0] = rank == me ? count : 0, j->counts[n + rank] = me ? 0 : count;
        sf_cluster_exchange(j->cluster, bytes, j->rows, j->counts, j->rows, j->counts + n);
    }
    if (!me) sf_writer_put(&j->writer, j->rows, count * bytes);
    return status;
}

static sf_status send_all(save_job *j) {
    sf_status status = SF_OK;
    for (int degree = SF_MAX_SH_DEGREE; degree >= 0; degree--)
        for (size_t rank = 0; rank < (size_t)j->cluster->size; rank++) {
            const uint64_t *banded = j->banded + SF_BANDS * rank;
            size_t at = degree < SF_MAX_SH_DEGREE ? (size_t)banded[degree + 1] : 0;
            for (size_t end = (size_t)banded[degree]; at < end; at += ROWS) {
                sf_status sent = send_rows(j, rank, at, end - at < ROWS ? end - at : ROWS);
                if (!status) status = sent;
            }
        }
    return status;
}

static sf_status write_file(const sf_fitter *f, save_job *j, size_t count, const char *path) {
    int writes = !j->cluster->rank;
    sf_status status = writes ? sf_writer_open(&j->writer, f->ctx, path) : SF_OK;
    int opened = writes && !status;
    if (opened) sf_ply_put_header(&j->writer, j->part, count, j->sh_degree);
    if (any_failed(f, status)) {
        if (opened) sf_writer_abandon(&j->writer);
        return status ? status : SF_ERR_IO;
    }
    status = send_all(j);
    if (any_failed(f, status)) {
        if (opened) sf_writer_abandon(&j->writer);
        return status ? status : SF_ERR_IO;
    }
    return opened ? sf_writer_commit(&j->writer) : SF_OK;
}

/* What a whole model is checked for before it is written. */
static sf_status prepare(sf_model *part, const char *path, const sf_model_file_options *o) {
    static const double zero[3];
    sf_status status = sf_model_check(part, path);
    if (!status && sf_model_has_origin(part) && o->world) {
        sf_model_set_origin(part, zero);
        status = sf_model_check(part, path);
    }
    return status;
}

sf_status sf_ranks_save_ply(const sf_fitter *f, sf_model *part, const char *path,
                            const sf_model_file_options *o) {
    sf_cluster *c = sf_cluster_of(f->ctx);
    size_t n = (size_t)c->size, count = sf_total(f, part->count);
    save_job j = {.cluster = c, .part = part, .sh_degree = sf_kept_degree(part->sh_degree, o)};
    uint64_t own[SF_BANDS], *banded = sf_alloc(f->ctx, n * SF_BANDS, sizeof *banded);
    j.rows = sf_alloc(f->ctx, ROWS, sf_ply_row_bytes(j.sh_degree));
    j.counts = sf_alloc(f->ctx, 2 * n, sizeof *j.counts);
    sf_status status = banded && j.rows && j.counts ? prepare(part, path, o) : SF_ERR_MEMORY;
    if (!any_failed(f, status)) {
        for (int band = 0; band < SF_BANDS; band++) own[band] = part->banded[band];
        sf_cluster_gather_bytes(c, own, sizeof own, banded);
        j.banded = banded;
        status = write_file(f, &j, count, path);
    } else if (!status) {
        status = SF_ERR_ARGUMENT; /* another rank says why */
    }
    sf_free(f->ctx, banded);
    sf_free(f->ctx, j.rows);
    sf_free(f->ctx, j.counts);
    return status;
}
