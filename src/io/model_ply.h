/* model_ply.h - what INRIA's .ply of Gaussians and PlayCanvas's compressed one share. */
#ifndef SF_IO_MODEL_PLY_H
#define SF_IO_MODEL_PLY_H

#include "model_file.h"
#include "ply.h"

/* The degree of the SH by the properties f_rest_... of the element entered. SF_ERR_FORMAT: no degree has so
 * many. */
sf_status sf_ply_find_degree(sf_context *ctx, const char *path, const sf_ply *ply, int *degree);

/* Binds the values of a Gaussian whose names begin with `prefix`, each to its place in sf_gaussian, of a file
 * of file_degree to a model of degree. */
sf_status sf_ply_bind_values(sf_ply *ply, const char *prefix, int file_degree, int degree);

/* Ends a builder after the last Gaussian, or, where status says so, after a failure: returns that, or what
 * sf_model_builder_end says. */
sf_status sf_ply_end_builder(sf_ply *ply, sf_model_builder *in, sf_status status, sf_model **model);

/* Writes the header of a file of `count` Gaussians like the model's. */
void sf_ply_put_header(sf_writer *w, const sf_model *model, size_t count, int sh_degree);
/* The rows of Gaussians first .. first+count-1 as a file has them, sf_ply_row_bytes each. */
size_t sf_ply_row_bytes(int sh_degree);
sf_status sf_ply_encode(const sf_model *model, size_t first, size_t count, int sh_degree, uint8_t *rows);

/* A compressed .ply, its vertices entered. On failure *model stays as it is. */
sf_status sf_compressed_ply_load(sf_context *ctx, const char *path, sf_ply *ply,
                                 const sf_model_file_options *options, sf_model **model);

#endif
