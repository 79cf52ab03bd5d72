/* gltf_format.h - glTF 2.0 with KHR_gaussian_splatting: what the reader and the writer share. */
#ifndef SF_IO_GLTF_FORMAT_H
#define SF_IO_GLTF_FORMAT_H

#include "gaussian.h"

#define SF_GLTF_EXTENSION "KHR_gaussian_splatting"

enum {
    SF_GLB_MAGIC = 0x46546c67, /* "glTF" */
    SF_GLB_JSON = 0x4e4f534a,  /* "JSON" */
    SF_GLB_BIN = 0x004e4942,   /* "BIN", 0 */
    SF_GLB_HEADER = 12,
    SF_GLB_CHUNK = 8, /* header of a chunk */
    SF_GLTF_FLOAT = 5126,
    SF_GLTF_ATTRIBUTES = 4 + SF_MAX_COEFFICIENTS
};

/* An attribute: POSITION, ROTATION, SCALE, OPACITY, then the coefficients of the SH in the model's order. */
typedef struct sf_gltf_attribute {
    char name[64];
    int components;
} sf_gltf_attribute;

sf_gltf_attribute sf_gltf_attribute_at(int index);

/* Half a turn about z, between a model's axes (right, down, front) and glTF's (left, up, front). Twice it is
 * as it was, but for the sign of the whole quaternion. */
void sf_gltf_turn(sf_gaussian *g, int sh_degree);

#endif
