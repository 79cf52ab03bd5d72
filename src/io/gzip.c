/* gzip.c - gzip streams: one being written to a file, and one in memory being read with a bound. */
#include "gzip.h"

#include <limits.h>

enum { GZIP_WINDOW = 15 + 16, BEST_MEMORY = 9 };

static void *take_block(void *ctx, uInt items, uInt size) { return sf_alloc(ctx, items, size); }
static void give_block(void *ctx, void *block) { sf_free(ctx, block); }

static z_stream fresh(sf_context *ctx) {
    return (z_stream){.zalloc = take_block, .zfree = give_block, .opaque = ctx};
}

static uInt at_most(size_t size) { return size > UINT_MAX ? UINT_MAX : (uInt)size; }

/* ---- Out ---- */

sf_status sf_gzip_begin(sf_gzip_out *out, sf_writer *writer) {
    out->z = fresh(writer->ctx);
    out->writer = writer;
    out->status = SF_OK;
    if (deflateInit2(&out->z, Z_BEST_COMPRESSION, Z_DEFLATED, GZIP_WINDOW, BEST_MEMORY, Z_DEFAULT_STRATEGY))
        out->status = SF_ERR_MEMORY;
    return out->status;
}

static void pump(sf_gzip_out *out, int flush) {
    do {
        out->z.next_out = out->buffer;
        out->z.avail_out = sizeof out->buffer;
        deflate(&out->z, flush); /* fails only of wrong use */
        sf_writer_put(out->writer, out->buffer, sizeof out->buffer - out->z.avail_out);
    } while (!out->z.avail_out);
}

void sf_gzip_put(sf_gzip_out *out, const uint8_t *data, size_t size) {
    while (size && !out->status) {
        uInt part = at_most(size);
        out->z.next_in = (Bytef *)(uintptr_t)data; /* zlib reads it only */
        out->z.avail_in = part;
        pump(out, Z_NO_FLUSH);
        data += part;
        size -= part;
    }
}

void sf_gzip_expect_noise(sf_gzip_out *out) {
    if (out->status) return;
    out->z.avail_in = 0;
    do {
        out->z.next_out = out->buffer;
        out->z.avail_out = sizeof out->buffer;
        deflateParams(&out->z, Z_BEST_COMPRESSION, Z_FILTERED);
        sf_writer_put(out->writer, out->buffer, sizeof out->buffer - out->z.avail_out);
    } while (!out->z.avail_out);
}

sf_status sf_gzip_end(sf_gzip_out *out) {
    if (out->status) return out->status;
    out->z.avail_in = 0;
    pump(out, Z_FINISH);
    deflateEnd(&out->z);
    return SF_OK;
}

/* ---- In ---- */

sf_status sf_gzip_open(sf_gzip_in *in, sf_context *ctx, const char *path, const uint8_t *data, size_t size) {
    *in = (sf_gzip_in){.z = fresh(ctx), .ctx = ctx, .path = path, .left = size};
    in->z.next_in = (Bytef *)(uintptr_t)data;
    return inflateInit2(&in->z, GZIP_WINDOW) ? SF_ERR_MEMORY : SF_OK;
}

static int step(sf_gzip_in *in) {
    uInt shown = at_most(in->left);
    in->z.avail_in = shown;
    int result = inflate(&in->z, Z_NO_FLUSH);
    in->left -= shown - in->z.avail_in;
    return result;
}

sf_status sf_gzip_take(sf_gzip_in *in, uint8_t *to, size_t size, size_t *got) {
    *got = 0;
    while (*got < size && !in->ended) {
        uInt room = at_most(size - *got);
        in->z.next_out = to + *got;
        in->z.avail_out = room;
        int result = step(in);
        *got += room - in->z.avail_out;
        if (result == Z_STREAM_END)
            in->ended = 1;
        else if (result == Z_MEM_ERROR)
            return SF_ERR_MEMORY;
        else if (result == Z_BUF_ERROR)
            return SF_OK; /* no more data */
        else if (result != Z_OK)
            return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: gzip: %s", in->path,
                           in->z.msg ? in->z.msg : "is damaged");
    }
    return SF_OK;
}

size_t sf_gzip_rest(const sf_gzip_in *in) { return in->left; }

void sf_gzip_close(sf_gzip_in *in) { inflateEnd(&in->z); }
