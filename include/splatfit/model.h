/* model.h - a set of 3D Gaussians: the model that a fit produces. */
#ifndef SPLATFIT_MODEL_H
#define SPLATFIT_MODEL_H

#include <stddef.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The highest degree of the spherical harmonics: SF_MAX_SH_DEGREE. */
enum { SF_MAX_SH_DEGREE = 3 };

/* Plain arrays of raw parameters, or of gradients with respect to them. K = (sh_degree + 1)^2. */
typedef struct sf_gaussians {
    float *means;           /* [n][3], world units */
    float *quats;           /* [n][4], w x y z, any norm */
    float *log_scales;      /* [n][3], natural logarithm of the standard deviations, world units */
    float *logit_opacities; /* [n] */
    float *sh;              /* [n][K][3], coefficient-major, RGB innermost (M.4) */
} sf_gaussians;

/* Gaussians in the library's own memory. Several threads may read a model; no other thread may use it while
 * one changes it. */
typedef struct sf_model sf_model;

/* A model of `count` (0 .. 2^31 - 17) neutral Gaussians: mean 0, identity rotation, log-scale 0,
 * logit-opacity -20 (invisible), SH 0. sh_degree 0..3. */
SF_API sf_status sf_model_create(sf_context *context, size_t count, int sh_degree, sf_model **model);
SF_API void sf_model_destroy(sf_model **model);

/* The number of Gaussians; the highest SH degree that one of them may have. */
SF_API size_t sf_model_count(const sf_model *model);
SF_API int sf_model_sh_degree(const sf_model *model);

/* Whether the model was fitted with opacity compensation (M.3) and must be rendered with it. */
SF_API int sf_model_antialiased(const sf_model *model);
SF_API void sf_model_set_antialiased(sf_model *model, int antialiased);

/* The origin of the model's coordinates in the world: that of the scene it was fitted to
 * (sf_scene_get_origin), or what its file says. sf_model_set_origin moves the means, so that the Gaussians
 * stay where they are in the world; means are floats, so that those far from the origin are rounded. A .ply
 * states the origin in a comment, a .glb as the translation of its node; the other formats cannot, which the
 * log says. */
SF_API void sf_model_get_origin(const sf_model *model, double origin[3]);
SF_API void sf_model_set_origin(sf_model *model, const double origin[3]);

/* Copies Gaussians first .. first+count-1 from or to the caller's arrays; an array that is NULL is left out.
 * sf_model_get gives 0 for bands that a Gaussian lacks (sf_model_pack). SF_ERR_ARGUMENT, and nothing is
 * copied: the range exceeds the model, or a value to set that is not 0 belongs to a band that its Gaussian
 * lacks. */
SF_API sf_status sf_model_set(sf_model *model, size_t first, size_t count, const sf_gaussians *from);
SF_API sf_status sf_model_get(const sf_model *model, size_t first, size_t count, const sf_gaussians *to);

/* Sets each Gaussian's SH degree to that of its highest band with a value that is not 0. The bands above are
 * dropped, which saves memory and time. Gaussians are sorted by falling degree; those of one degree keep
 * their order. Renders do not change, except where Gaussians have exactly the same depth. A new or loaded
 * model has all bands for all of its Gaussians; files of a packed model are padded with 0s. SF_ERR_MEMORY:
 * the model is unchanged. */
SF_API sf_status sf_model_pack(sf_model *model);

/* count[d]: the number of Gaussians of SH degree d. sf_model_floats: the number of the model's parameters, 14
 * to 59 for each Gaussian. */
SF_API void sf_model_degrees(const sf_model *model, size_t count[SF_MAX_SH_DEGREE + 1]);
SF_API size_t sf_model_floats(const sf_model *model);

/* A similarity of space: p' = scale R p + move. */
typedef struct sf_similarity {
    double R[9];    /* a rotation, row-major, orthonormal to 1e-6 */
    double scale;   /* > 0 */
    double move[3]; /* world units, of the result */
} sf_similarity;

/* Moves a model: means, rotations, scales and all SH bands, so that a camera that is moved in the same way
 * renders the same picture. The origin is rotated and scaled; the means take the move. SF_ERR_ARGUMENT, and
 * the model is unchanged: values that are not finite, a reflection, a scale of 0 or less. */
SF_API sf_status sf_model_transform(sf_model *model, const sf_similarity *motion);

/* Finds the similarity that takes the cameras of one world to the same cameras in another, from[count] to
 * to[count]. R is the mean of what the cameras' rotations say; scale and move are those of least squares
 * between their places. 0: there is no camera, or all of one world are in one place; else 1. */
SF_API int sf_similarity_between(const sf_camera *from, const sf_camera *to, size_t count,
                                 sf_similarity *similarity);

/* Moves a camera: it sees in the moved world what it saw before. */
SF_API void sf_camera_transform(sf_camera *camera, const sf_similarity *motion);

/* Keeps the Gaussians whose means lie in a box, edges included, in their order. SF_ERR_ARGUMENT: low above
 * high, or not a number; SF_ERR_EMPTY: no mean lies in the box; SF_ERR_MEMORY. On failure the model is
 * unchanged. */
SF_API sf_status sf_model_crop(sf_model *model, const double low[3], const double high[3]);

/* The position, size and orientation of a model, estimated robustly: distant Gaussians count little. */
typedef struct sf_model_bounds {
    double center[3]; /* medians of the means */
    double radius;    /* distance from the center within which 4 of 5 means lie; 1 where that is 0 */
    double normal[3]; /* unit normal of the plane that fits the means best, on the side nearer to -y */
    double flatness;  /* standard deviation of the means along the normal, divided by that along the plane's
                         shorter axis: 0 (a plane) to 1 */
} sf_model_bounds;

/* SF_ERR_EMPTY: there is no Gaussian; SF_ERR_MEMORY. */
SF_API sf_status sf_model_get_bounds(const sf_model *model, sf_model_bounds *bounds);

/* Files that hold a model. */
typedef enum sf_model_format {
    SF_MODEL_AUTO, /* written: by the extension (.ply where there is no extension); read: .splat, .gltf and
                      .json by the extension, the others by their first bytes */
    SF_MODEL_PLY,  /* INRIA's .ply: raw float values, exact */
    SF_MODEL_SPZ, /* .spz: quantised columns, compressed; the fields' errors are listed in src/io/README.md */
    SF_MODEL_SPLAT, /* .splat: 32 bytes a Gaussian without higher SH bands, for previews */
    SF_MODEL_GLTF,  /* .glb, read also .gltf: glTF 2.0 with KHR_gaussian_splatting, floats, in glTF's own axes
                        (a model's x and y negated) */
    SF_MODEL_SOG /* .sog, read also the meta.json of a folder: PlayCanvas's SOG version 2 (read also 1); needs
                     a library built with libwebp, and for reading also with libzip */
} sf_model_format;

/* The axes of a .spz: most files do not state them, an extension of the format may. */
typedef enum sf_spz_frame {
    SF_SPZ_FRAME_OWN, /* read: as the extension 0xADBE0003 says, else the axes of a .ply; written: the axes
                         of a .ply */
    SF_SPZ_FRAME_RUB  /* the file is right, up, back, the model right, down, front: y and z are negated */
} sf_spz_frame;

/* How a model is written and read. Start from sf_model_file_options_default(). */
typedef struct sf_model_file_options {
    sf_model_format format; /* AUTO: by name or content */
    int sh_degree;          /* bands above it are left out, 0..3; -1: all bands are kept */
    int sh_bits[2]; /* .spz, written: bits kept of each SH value of band 1 and of the bands above, 1..8:
                       values lie 2^(1 - bits) apart in -1..1. Both 0: more bits for Gaussians that cover
                       much of a picture, fewer for the others */
    sf_spz_frame spz_frame; /* .spz, read and written */
    int world; /* written: 1: means relative to the world's 0 in place of the model's origin; they are floats,
                  and the log says how far apart floats are there */
    int part, parts; /* read: of so many parts this one alone, 0 .. parts-1, for a fit on as many ranks
                        (cluster.h); parts 0 or 1, and files of glTF: the whole model */
} sf_model_file_options;

/* SF_MODEL_AUTO, all bands, bits by what each Gaussian covers, the model's own frame and origin. */
SF_API sf_model_file_options sf_model_file_options_default(void);

/* Reads a model: an INRIA .ply (by property name, any order, with or without normals, f_rest and comments), a
 * .spz (gzip, versions 1 to 3; version 4 where the library is built with libzstd), a .splat, or a glTF file
 * with KHR_gaussian_splatting (.glb, .gltf with its buffers beside it). Opacities whose logit is
 * infinite get +-20, log-scales below -40 get -40. Gaussians with another non-finite value, a zero quaternion
 * or a log-scale above 20 are left out, counted and reported to the log; where all are, it is SF_ERR_FORMAT.
 * Data that is skipped, such as SH band 4 and extensions of a .spz, is also logged. options NULL: the
 * defaults. SF_ERR_IO, SF_ERR_FORMAT, SF_ERR_UNSUPPORTED (another version), SF_ERR_MEMORY, SF_ERR_ARGUMENT
 * (an option out of its range). */
SF_API sf_status sf_model_load_as(sf_context *context, const char *path, const sf_model_file_options *options,
                                  sf_model **model);
SF_API sf_status sf_model_load(sf_context *context, const char *path, sf_model **model);

/* Whether a model can be written under this name with SF_MODEL_AUTO: it ends in .ply, .spz, .splat, .glb or
 * .sog, in small letters or capitals, or has no ending, which makes a .ply. SF_ERR_UNSUPPORTED where not. */
SF_API sf_status sf_model_check_name(sf_context *context, const char *path);

/* Writes a model under a temporary name and renames it; a device, a pipe and "-" (standard output) are
 * written directly. SF_ERR_ARGUMENT: the model has values that other tools cannot read (those that
 * sf_model_load_as leaves out); SF_ERR_UNSUPPORTED: a name that sf_model_check_name refuses. A value that a
 * .spz cannot hold is replaced by the nearest that it can, counted and logged. The Gaussians of a .spz are
 * sorted by position, those of a .splat by weight. On failure an older file at `path` is unchanged. options
 * NULL: the defaults. */
SF_API sf_status sf_model_save_as(const sf_model *model, const char *path,
                                  const sf_model_file_options *options);
SF_API sf_status sf_model_save(const sf_model *model, const char *path);

#ifdef __cplusplus
}
#endif
#endif
