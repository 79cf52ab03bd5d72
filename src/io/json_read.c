/* json_read.c - see json_read.h. */
#include "json_read.h"

#include "../base/file.h"

sf_status sf_json_read(sf_context *ctx, const char *file, uint64_t most, json_t **root) {
    uint8_t *data;
    size_t size;
    json_error_t error;
    *root = NULL;
    sf_status status = sf_read_text(ctx, file, most, &data, &size);
    if (status) return status;
    *root = json_loadb((const char *)data, size, 0, &error);
    sf_free(ctx, data);
    if (*root) return SF_OK;
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: line %d: JSON: %s", file, error.line, error.text);
}
