/* gltf_data.c - see gltf_data.h. */
#include "gltf_data.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "../base/bytes.h"
#include "gltf_format.h"
#include "model_file.h"
#include "paths.h"

enum { COUNT_MOST = INT32_MAX - SF_LANES, STRIDE_MOST = 252, BYTE = 5120, SHORT = 5122 };

static const uint64_t JSON_MOST = 1 << 26, NUMBER_MOST = (uint64_t)1 << 40;

/* ---- The file ---- */

static sf_status check_required(const sf_gltf *in) {
    static const char *const known[] = {SF_GLTF_EXTENSION, "KHR_mesh_quantization"};
    const json_t *item;
    size_t i;
    json_array_foreach(json_object_get(in->root, "extensionsRequired"), i, item) {
        const char *name = json_string_value(item);
        if (name && strcmp(name, known[0]) && strcmp(name, known[1]))
            return sf_fail(in->ctx, SF_ERR_UNSUPPORTED,
                           "%s: extensionsRequired: %.60s is not read: convert the file to one without it",
                           in->path, name);
    }
    return SF_OK;
}

static sf_status parse_json(sf_gltf *in, const uint8_t *text, size_t size) {
    json_error_t error;
    if (size > JSON_MOST)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: JSON: %zu bytes are more than 64 MiB", in->path, size);
    in->root = json_loadb((const char *)text, size, 0, &error);
    if (!in->root)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: line %d: JSON: %s", in->path, error.line, error.text);
    const char *version = json_string_value(json_object_get(json_object_get(in->root, "asset"), "version"));
    if (!version) return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: asset: version: is missing", in->path);
    if (strncmp(version, "2.", 2))
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: asset: version: %.20s is not 2", in->path, version);
    return check_required(in);
}

/* A chunk's header, and the chunk; 0: it is not whole. */
static int take_chunk(sf_bytes *b, uint32_t type, const uint8_t **data, size_t *size) {
    *size = sf_bytes_u32(b);
    int good = sf_bytes_u32(b) == type;
    *data = sf_bytes_take(b, *size);
    return good && *data;
}

static sf_status open_glb(sf_gltf *in) {
    sf_bytes b = {.data = in->file, .size = in->size, .at = 4};
    const uint8_t *json;
    size_t size;
    uint32_t version = sf_bytes_u32(&b), all = sf_bytes_u32(&b);
    if (version != 2)
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: version: %lu is not 2", in->path,
                       (unsigned long)version);
    if (all > in->size || all < SF_GLB_HEADER)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: truncated: %zu of %lu bytes", in->path, in->size,
                       (unsigned long)all);
    b.size = all;
    if (!take_chunk(&b, SF_GLB_JSON, &json, &size))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: its first chunk is not JSON, or ends behind the file",
                       in->path);
    if (sf_bytes_left(&b) && !take_chunk(&b, SF_GLB_BIN, &in->bin, &in->bin_size))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: its second chunk is not BIN, or ends behind the file",
                       in->path);
    return parse_json(in, json, size);
}

sf_status sf_gltf_open(sf_gltf *in, sf_context *ctx, const char *path) {
    *in = (sf_gltf){.ctx = ctx, .path = path};
    sf_status status = sf_read_file(ctx, path, SF_MODEL_FILE_MOST, &in->file, &in->size);
    if (status) return status;
    if (in->size >= 4 && !memcmp(in->file, "glTF", 4)) return open_glb(in);
    return parse_json(in, in->file, in->size);
}

void sf_gltf_close(sf_gltf *in) {
    for (int i = 0; i < SF_GLTF_BUFFERS; i++) sf_free(in->ctx, in->buffers[i].owned);
    json_decref(in->root);
    sf_free(in->ctx, in->file);
}

/* ---- Numbers ---- */

/* *value stays where the key is missing. */
static sf_status get_number(const sf_gltf *in, const json_t *object, const char *where, const char *key,
                            uint64_t most, uint64_t *value) {
    const json_t *number = json_object_get(object, key);
    if (!number) return SF_OK;
    json_int_t n = json_integer_value(number);
    if (!json_is_integer(number) || n < 0 || (uint64_t)n > most)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: %s: is not a whole number of 0..%llu", in->path,
                       where, key, (unsigned long long)most);
    *value = (uint64_t)n;
    return SF_OK;
}

sf_status sf_gltf_item(const sf_gltf *in, const json_t *index, const char *list, const json_t **item) {
    json_int_t n = json_integer_value(index);
    *item =
        json_is_integer(index) && n >= 0 ? json_array_get(json_object_get(in->root, list), (size_t)n) : NULL;
    if (json_is_object(*item)) return SF_OK;
    return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: there is no number %lld", in->path, list, (long long)n);
}

/* ---- Buffers ---- */

static int base64_digit(int c) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *at = c ? strchr(digits, c) : NULL;
    return at ? (int)(at - digits) : -1;
}

static sf_status load_base64(const sf_gltf *in, const char *text, sf_gltf_buffer *buffer) {
    uint32_t bits = 0;
    int held = 0;
    const char *c = text;
    buffer->owned = sf_alloc(in->ctx, strlen(text) / 4 * 3 + 4, 1);
    if (!buffer->owned) return SF_ERR_MEMORY;
    for (; *c && *c != '='; c++) {
        int digit = base64_digit(*c);
        if (digit < 0) return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: buffers: uri: is not base64", in->path);
        bits = bits << 6 | (uint32_t)digit;
        held += 6;
        if (held < 8) continue;
        held -= 8;
        buffer->owned[buffer->size++] = (uint8_t)(bits >> held);
    }
    buffer->data = buffer->owned;
    return SF_OK;
}

/* %20 and the like, in place. */
static void decode_percents(char *text) {
    char *to = text;
    for (const char *c = text; *c; c++) {
        char digits[3] = {0};
        if (*c == '%' && isxdigit((unsigned char)c[1]) && isxdigit((unsigned char)c[2])) {
            memcpy(digits, c + 1, 2);
            c += 2;
        }
        *to++ = (char)(*digits ? strtol(digits, NULL, 16) : *c);
    }
    *to = 0;
}

static sf_status load_beside(const sf_gltf *in, const char *uri, sf_gltf_buffer *buffer) {
    char *name = sf_text_copy(in->ctx, uri), *folder = sf_path_folder(in->ctx, in->path);
    if (name) decode_percents(name);
    char *path = name && folder ? sf_path_join(in->ctx, folder, name) : NULL;
    sf_status status = SF_ERR_MEMORY;
    if (path && (strchr(name, ':') || strchr(name, '\\') || !sf_name_stays_inside(name)))
        status = sf_fail(in->ctx, SF_ERR_FORMAT, "%s: buffers: uri: %.100s leads out of the folder", in->path,
                         uri);
    else if (path)
        status = sf_read_file(in->ctx, path, SF_MODEL_FILE_MOST, &buffer->owned, &buffer->size);
    if (!status) buffer->data = buffer->owned;
    sf_free(in->ctx, name);
    sf_free(in->ctx, folder);
    sf_free(in->ctx, path);
    return status;
}

static sf_status load_uri(const sf_gltf *in, const char *uri, sf_gltf_buffer *buffer) {
    const char *base64 = strstr(uri, ";base64,");
    if (strncmp(uri, "data:", 5)) return load_beside(in, uri, buffer);
    if (base64) return load_base64(in, base64 + 8, buffer);
    return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: buffers: uri: data that is not base64", in->path);
}

static sf_status load_buffer(sf_gltf *in, size_t index, const json_t *json, sf_gltf_buffer *buffer) {
    const json_t *uri = json_object_get(json, "uri");
    uint64_t length = 0;
    sf_status status = get_number(in, json, "buffers", "byteLength", NUMBER_MOST, &length);
    if (status) return status;
    if (json_is_string(uri)) {
        status = load_uri(in, json_string_value(uri), buffer);
    } else if (index == 0 && in->bin) {
        buffer->data = in->bin;
        buffer->size = in->bin_size;
    } else {
        status = sf_fail(in->ctx, SF_ERR_FORMAT, "%s: buffers: number %zu has no uri", in->path, index);
    }
    if (!status && buffer->size < length)
        status =
            sf_fail(in->ctx, SF_ERR_FORMAT, "%s: truncated: buffers: %zu of the %llu bytes of number %zu",
                    in->path, buffer->size, (unsigned long long)length, index);
    if (status) return status;
    buffer->size = (size_t)length;
    in->loaded += length;
    return SF_OK;
}

static sf_status find_buffer(sf_gltf *in, const json_t *index, const sf_gltf_buffer **found) {
    const json_t *json;
    sf_status status = sf_gltf_item(in, index, "buffers", &json);
    if (status) return status;
    size_t i = (size_t)json_integer_value(index);
    if (i >= SF_GLTF_BUFFERS)
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: buffers: number %zu is above %d", in->path, i,
                       SF_GLTF_BUFFERS - 1);
    *found = &in->buffers[i];
    return in->buffers[i].data ? SF_OK : load_buffer(in, i, json, &in->buffers[i]);
}

/* ---- Columns ---- */

/* Bytes of the component types from 5120 on: signed and unsigned bytes and shorts, (none), unsigned ints,
 * floats. */
static uint32_t bytes_of(uint64_t type) {
    static const uint32_t bytes[] = {1, 1, 2, 2, 0, 4, 4};
    return type >= BYTE && type <= SF_GLTF_FLOAT ? bytes[type - BYTE] : 0;
}

static sf_status check_accessor(const sf_gltf *in, const json_t *json, const char *name, int components) {
    static const char *const types[] = {"", "SCALAR", "", "VEC3", "VEC4"};
    const char *type = json_string_value(json_object_get(json, "type"));
    if (!type || strcmp(type, types[components]))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: type: %.20s is not %s", in->path, name,
                       type ? type : "(none)", types[components]);
    if (json_object_get(json, "sparse") || !json_object_get(json, "bufferView"))
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: %s: is sparse, or without a bufferView", in->path,
                       name);
    return SF_OK;
}

/* Where the numbers are: an accessor's in its view, the view's in its buffer. */
typedef struct place {
    uint64_t type, count, offset, stride, view_offset, view_length;
} place;

static sf_status read_place(const sf_gltf *in, const json_t *json, const json_t *view, const char *name,
                            place *at) {
    sf_status status = get_number(in, json, name, "componentType", NUMBER_MOST, &at->type);
    if (!status) status = get_number(in, json, name, "count", COUNT_MOST, &at->count);
    if (!status) status = get_number(in, json, name, "byteOffset", NUMBER_MOST, &at->offset);
    if (!status) status = get_number(in, view, name, "byteStride", STRIDE_MOST, &at->stride);
    if (!status) status = get_number(in, view, name, "byteOffset", NUMBER_MOST, &at->view_offset);
    if (!status) status = get_number(in, view, name, "byteLength", NUMBER_MOST, &at->view_length);
    return status;
}

static sf_status check_place(const sf_gltf *in, const place *at, const char *name, uint64_t element,
                             size_t buffer) {
    if (!element)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: componentType: %llu is none", in->path, name,
                       (unsigned long long)at->type);
    if (at->stride < element)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: byteStride: %llu is less than an element's %llu",
                       in->path, name, (unsigned long long)at->stride, (unsigned long long)element);
    uint64_t end = at->count ? at->offset + (at->count - 1) * at->stride + element : at->offset;
    if (end > at->view_length || at->view_offset + at->view_length > buffer)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: count: %llu elements end behind the buffer", in->path,
                       name, (unsigned long long)at->count);
    return SF_OK;
}

sf_status sf_gltf_find_column(sf_gltf *in, const json_t *accessor, const char *name, int components,
                              sf_gltf_column *column) {
    const json_t *json, *view = NULL;
    const sf_gltf_buffer *buffer = NULL;
    place at = {0};
    sf_status status = sf_gltf_item(in, accessor, "accessors", &json);
    if (!status) status = check_accessor(in, json, name, components);
    if (!status) status = sf_gltf_item(in, json_object_get(json, "bufferView"), "bufferViews", &view);
    if (!status) status = read_place(in, json, view, name, &at);
    if (!status) status = find_buffer(in, json_object_get(view, "buffer"), &buffer);
    if (status) return status;
    uint32_t element = bytes_of(at.type) * (uint32_t)components;
    if (!at.stride) at.stride = element;
    status = check_place(in, &at, name, element, buffer->size);
    if (status) return status;
    *column = (sf_gltf_column){.data = buffer->data + at.view_offset + at.offset,
                               .count = (size_t)at.count,
                               .stride = (size_t)at.stride,
                               .bytes = element,
                               .type = (int)at.type,
                               .normalized = json_is_true(json_object_get(json, "normalized"))};
    return SF_OK;
}

double sf_gltf_value(const sf_gltf_column *column, size_t i, int component) {
    int size = (int)bytes_of((uint64_t)column->type);
    sf_bytes b = {.data = column->data + i * column->stride + (size_t)(component * size),
                  .size = (size_t)size};
    if (column->type == SF_GLTF_FLOAT) return (double)sf_bytes_f32(&b);
    uint64_t u = sf_bytes_uint(&b, size), most = ((uint64_t)1 << (8 * size)) - 1;
    int is_signed = column->type == BYTE || column->type == SHORT;
    double value = (double)u, full = (double)most;
    if (is_signed) {
        if (u > most / 2) value -= full + 1;
        full = (double)(most / 2);
    }
    if (!column->normalized) return value;
    return value < -full ? -1 : value / full;
}
