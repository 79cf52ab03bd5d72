/* gltf_data.h - the JSON of a glTF file, its buffers, and accessors as columns of numbers. */
#ifndef SF_IO_GLTF_DATA_H
#define SF_IO_GLTF_DATA_H

#include <jansson.h>

#include "../base/context.h"

enum { SF_GLTF_BUFFERS = 64 };

typedef struct sf_gltf_buffer {
    const uint8_t *data;
    size_t size;
    uint8_t *owned; /* NULL: it is a part of the file */
} sf_gltf_buffer;

typedef struct sf_gltf {
    sf_context *ctx;
    const char *path;
    uint8_t *file;
    size_t size;
    json_t *root;
    const uint8_t *bin; /* the binary chunk of a .glb; NULL: no such chunk */
    size_t bin_size;
    sf_gltf_buffer buffers[SF_GLTF_BUFFERS];
    uint64_t loaded; /* bytes of the buffers that have been asked for */
    size_t visits;   /* of nodes, the caller's to count */
} sf_gltf;

/* Numbers of one attribute in a buffer. */
typedef struct sf_gltf_column {
    const uint8_t *data;
    size_t count, stride;
    uint32_t bytes; /* of an element */
    int type, normalized;
} sf_gltf_column;

/* Reads a .glb or a .gltf. sf_gltf_close releases it, also after a failure. SF_ERR_UNSUPPORTED: another
 * version, an extension that is required and not read. */
sf_status sf_gltf_open(sf_gltf *in, sf_context *ctx, const char *path);
void sf_gltf_close(sf_gltf *in);

/* The item of a list of the root object at an index; SF_ERR_FORMAT: no such item. */
sf_status sf_gltf_item(const sf_gltf *in, const json_t *index, const char *list, const json_t **item);

/* The column of an accessor with the given number of components; messages name the attribute. Loads its
 * buffer from the .glb, from base64, or from a file beside this one. */
sf_status sf_gltf_find_column(sf_gltf *in, const json_t *accessor, const char *name, int components,
                              sf_gltf_column *column);

/* A number; of normalised types -1..1 or 0..1. */
double sf_gltf_value(const sf_gltf_column *column, size_t i, int component);

#endif
