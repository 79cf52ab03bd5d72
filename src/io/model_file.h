/* model_file.h - what each format of model files has to offer to sf_model_load_as and sf_model_save_as. */
#ifndef SF_IO_MODEL_FILE_H
#define SF_IO_MODEL_FILE_H

#include "../base/file.h"
#include "gaussian.h"

/* Largest file that is read. */
#define SF_MODEL_FILE_MOST ((uint64_t)1 << 40)

/* Readers. On failure *model is NULL. */
sf_status sf_ply_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model);
sf_status sf_spz_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model);
sf_status sf_splat_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                        sf_model **model);
sf_status sf_gltf_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                       sf_model **model);
sf_status sf_sog_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model);

/* Writers of a model without faults to an open file that the caller commits or abandons; `sh_degree` is of
 * the bands to write. */
sf_status sf_ply_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options);
sf_status sf_spz_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options);
sf_status sf_splat_put(sf_writer *w, const sf_model *model, int sh_degree,
                       const sf_model_file_options *options);
sf_status sf_gltf_put(sf_writer *w, const sf_model *model, int sh_degree,
                      const sf_model_file_options *options);
sf_status sf_sog_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options);

/* The bytes of a .splat, SF_SPLAT_BYTES a Gaussian, into memory; what values it cannot hold is not asked. In
 * the same order, sf_splat_sh_bytes a Gaussian, what it leaves out of the colours, for viewers of our own:
 * values of -1..1 as 128 + 128 value in a byte, first the [3] by which the colour without the bands is beyond
 * 0..1, then [K-1][3] of the bands 1 to sh_degree, then zeros up to a multiple of 16 bytes. sh may be NULL
 * where sh_degree is 0; else sh_degree is not above the model's. */
enum { SF_SPLAT_BYTES = 32, SF_SPLAT_SH_MOST = 48 };
size_t sf_splat_sh_bytes(int sh_degree);
sf_status sf_splat_encode(const sf_model *model, uint8_t *data, int sh_degree, uint8_t *sh);

/* Options whose values are in range, or SF_ERR_ARGUMENT; and the format that they and the name say, or
 * SF_ERR_UNSUPPORTED. */
sf_status sf_model_file_check(sf_context *ctx, const char *path, const sf_model_file_options *options,
                              sf_model_format *format);

/* The bands to keep of a model that has `sh_degree`. */
int sf_kept_degree(int sh_degree, const sf_model_file_options *options);

/* The highest degree of files that are read: of 4 the last band is left out. */
enum { SF_FILE_SH_DEGREE = 4 };

/* The bands to keep of a file that has `sh_degree`; what no model holds is reported to the log. */
int sf_file_degree(sf_context *ctx, const char *path, int sh_degree, const sf_model_file_options *options);

#endif
