/* spz_read.c - Gaussians in, from .spz: versions 1 to 3 in a stream of gzip, version 4 in streams of zstd. */
#include <stdio.h>
#ifdef SF_HAVE_ZSTD
#include <zstd.h>
#endif

#include "../base/bytes.h"
#include "../base/memory.h"
#include "gzip.h"
#include "model_file.h"
#include "spz.h"

enum {
    FRACTION_MOST = 30,
    FLAG_ANTIALIASED = 1,
    FLAG_EXTENDED = 2,
    EXTENSION_HEAD = 8,        /* of an extension: its type, its bytes after these */
    AXES_MOST = 16,            /* coordinate systems that have a number, */
    AXES_READ = 8,             /* and those whose axes are a model's or their opposites */
    EXTENSIONS_MOST = 1 << 20, /* bytes that are read over behind the columns */
    STREAMS_HEADER = 32,
    STREAM_ENTRY = 16,       /* of the table of streams: packed and unpacked bytes */
    UNPACKED_FREE = 1 << 24, /* bytes that any file may unpack to, */
    UNPACKED_RATIO = 200     /* or this many times the packed size; real models have a ratio of 2 to 4 */
};

/* The type of the extension that says which axes there are, in a uint32: SPZ_ADOBE_coordinate_system. */
static const uint32_t axes_type = 0xADBE0003;

typedef struct spz_in {
    sf_context *ctx;
    const char *path;
    const uint8_t *data; /* of the file */
    size_t size;
    sf_spz_header header;
    uint32_t axes; /* as an extension numbers them; 0: nothing says */
    const uint8_t *columns[SF_SPZ_COLUMNS];
    uint8_t *body; /* the columns, one behind the other */
} spz_in;

static sf_status refuse(const spz_in *s, sf_status status, const char *field, unsigned long value,
                        const char *why) {
    return sf_fail(s->ctx, status, "%s: %s: %lu %s", s->path, field, value, why);
}

/* The first 16 bytes of all versions. */
static sf_status parse_header(spz_in *s, const uint8_t *data) {
    sf_bytes b = {.data = data, .size = SF_SPZ_HEADER};
    sf_spz_header *h = &s->header;
    if (!sf_spz_begins(data, 4) || data[0] != 'N')
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: is not a .spz file: it does not begin with NGSP", s->path);
    b.at = 4;
    h->version = sf_bytes_u32(&b);
    h->count = sf_bytes_u32(&b);
    h->sh_degree = sf_bytes_u8(&b);
    h->fraction = sf_bytes_u8(&b);
    int flags = sf_bytes_u8(&b);
    h->antialiased = (flags & FLAG_ANTIALIASED) != 0;
    h->extended = (flags & FLAG_EXTENDED) != 0;
    if (h->version < 1 || h->version > SF_SPZ_STREAMS)
        return refuse(s, SF_ERR_UNSUPPORTED, "version", h->version, "is none of 1 to 4");
    if (h->sh_degree > SF_FILE_SH_DEGREE)
        return refuse(s, SF_ERR_FORMAT, "SH degree", (unsigned long)h->sh_degree, "is not in 0..4");
    if (h->fraction > FRACTION_MOST)
        return refuse(s, SF_ERR_FORMAT, "fractional bits", (unsigned long)h->fraction, "are more than 30");
    if (h->count > INT32_MAX - SF_LANES)
        return refuse(s, SF_ERR_UNSUPPORTED, "count", h->count, "Gaussians are more than 2^31 - 17");
    return SF_OK;
}

static uint64_t column_bytes(const spz_in *s, sf_spz_column column) {
    return (uint64_t)s->header.count * (uint64_t)sf_spz_width(&s->header, column);
}

static uint64_t body_bytes(const spz_in *s) {
    uint64_t bytes = 0;
    for (sf_spz_column c = SF_SPZ_MEANS; c < SF_SPZ_COLUMNS; c++) bytes += column_bytes(s, c);
    return bytes;
}

static sf_status truncated(const spz_in *s, uint64_t have, uint64_t need) {
    return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: %llu of the %llu bytes of its %lu Gaussians",
                   s->path, (unsigned long long)have, (unsigned long long)need,
                   (unsigned long)s->header.count);
}

/* Room for the columns, where the file is long enough to hold them. */
static sf_status allocate_body(spz_in *s) {
    uint64_t bytes = body_bytes(s);
    if (bytes > UNPACKED_FREE && bytes / UNPACKED_RATIO > s->size)
        return sf_fail(
            s->ctx, SF_ERR_FORMAT,
            "%s: truncated: the %llu bytes of its %lu Gaussians are more than %d times the file's %zu",
            s->path, (unsigned long long)bytes, (unsigned long)s->header.count, UNPACKED_RATIO, s->size);
    if (bytes >= SIZE_MAX)
        return sf_fail(s->ctx, SF_ERR_MEMORY, "%s: %lu Gaussians are more than this machine can address",
                       s->path, (unsigned long)s->header.count);
    sf_status status = sf_memory_check(s->ctx, s->path, "Gaussians", bytes);
    if (status) return status;
    s->body = sf_alloc(s->ctx, (size_t)bytes + 1, 1);
    if (!s->body) return SF_ERR_MEMORY;
    const uint8_t *at = s->body;
    for (sf_spz_column c = SF_SPZ_MEANS; c < SF_SPZ_COLUMNS; c++) {
        s->columns[c] = at;
        at += column_bytes(s, c);
    }
    return SF_OK;
}

/* Extensions lie one behind the other; `more` bytes of them are not at hand. */
static void read_extensions(spz_in *s, const uint8_t *data, size_t size, size_t more) {
    sf_bytes b = {.data = data, .size = size};
    size_t ignored = more;
    while (size - b.at >= EXTENSION_HEAD) {
        uint32_t type = sf_bytes_u32(&b), bytes = sf_bytes_u32(&b);
        if (bytes > size - b.at) {
            b.at -= EXTENSION_HEAD;
            break;
        }
        if (type == axes_type && bytes == sizeof s->axes) {
            s->axes = sf_bytes_u32(&b);
            continue;
        }
        b.at += bytes;
        ignored += EXTENSION_HEAD + bytes;
    }
    ignored += size - b.at;
    if (ignored) sf_log(s->ctx, SF_LOG_WARNING, "%s: extensions ignored: %zu bytes", s->path, ignored);
}

/* ---- Versions 1 to 3 ---- */

/* Whatever more there is behind the columns: extensions where the header says so, else none may be. */
static sf_status read_over(spz_in *s, sf_gzip_in *in) {
    uint8_t scratch[4096], first[4096];
    size_t got, over = 0, kept = 0;
    while (!in->ended) {
        sf_status status = sf_gzip_take(in, scratch, sizeof scratch, &got);
        if (status) return status;
        if (!got && !in->ended)
            return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: the end of the gzip stream is missing",
                           s->path);
        if (!over) memcpy(first, scratch, kept = got);
        over += got;
        if (over > (s->header.extended ? EXTENSIONS_MOST : 0))
            return sf_fail(s->ctx, SF_ERR_FORMAT,
                           "%s: gzip: unpacks to more than the %llu bytes of its %lu Gaussians", s->path,
                           (unsigned long long)body_bytes(s), (unsigned long)s->header.count);
    }
    read_extensions(s, first, kept, over - kept);
    if (sf_gzip_rest(in))
        sf_log(s->ctx, SF_LOG_WARNING, "%s: %zu bytes after the end ignored", s->path, sf_gzip_rest(in));
    return SF_OK;
}

static sf_status unpack_gzip_open(spz_in *s, sf_gzip_in *in) {
    uint8_t header[SF_SPZ_HEADER];
    size_t got, bytes;
    sf_status status = sf_gzip_take(in, header, sizeof header, &got);
    if (!status && got < sizeof header)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: %zu of the header's %d bytes", s->path, got,
                       SF_SPZ_HEADER);
    if (!status) status = parse_header(s, header);
    if (!status && s->header.version == SF_SPZ_STREAMS)
        return refuse(s, SF_ERR_FORMAT, "version", s->header.version, "in a stream of gzip");
    if (!status) status = allocate_body(s);
    if (status) return status;
    bytes = (size_t)body_bytes(s);
    status = sf_gzip_take(in, s->body, bytes, &got);
    if (!status && got < bytes) return truncated(s, got, bytes);
    return status ? status : read_over(s, in);
}

static sf_status unpack_gzip(spz_in *s) {
    sf_gzip_in in;
    sf_status status = sf_gzip_open(&in, s->ctx, s->path, s->data, s->size);
    if (status) return status;
    status = unpack_gzip_open(s, &in);
    sf_gzip_close(&in);
    return status;
}

/* ---- Version 4 ---- */

#ifdef SF_HAVE_ZSTD

/* Where the table of streams is, and the first stream. */
typedef struct streams {
    size_t table, number, at;
} streams;

static sf_status find_streams(spz_in *s, streams *found) {
    sf_bytes b = {.data = s->data, .size = s->size, .at = SF_SPZ_HEADER - 1};
    found->number = sf_bytes_u8(&b);
    found->table = sf_bytes_u32(&b);
    if (s->size < STREAMS_HEADER)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: %zu of the header's %d bytes", s->path, s->size,
                       STREAMS_HEADER);
    if (found->number != (s->header.sh_degree ? SF_SPZ_COLUMNS : SF_SPZ_COLUMNS - 1))
        return refuse(s, SF_ERR_FORMAT, "streams", found->number, "are not one a column");
    if (found->table < STREAMS_HEADER || found->table > s->size ||
        found->number * STREAM_ENTRY > s->size - found->table)
        return refuse(s, SF_ERR_FORMAT, "table of streams at", found->table,
                      "is not in the file: truncated, or damaged");
    found->at = found->table + found->number * STREAM_ENTRY;
    read_extensions(s, s->data + STREAMS_HEADER, found->table - STREAMS_HEADER, 0);
    return SF_OK;
}

/* The sizes that the table gives are those of the columns, and fit the file. */
static sf_status check_streams(const spz_in *s, const streams *found) {
    sf_bytes b = {.data = s->data, .size = s->size, .at = found->table};
    uint64_t left = s->size - found->at;
    for (size_t i = 0; i < found->number; i++) {
        uint64_t packed = sf_bytes_u64(&b), bytes = sf_bytes_u64(&b);
        if (bytes != column_bytes(s, (sf_spz_column)i))
            return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: stream %zu: %llu bytes, not the %llu of %lu Gaussians",
                           s->path, i, (unsigned long long)bytes,
                           (unsigned long long)column_bytes(s, (sf_spz_column)i),
                           (unsigned long)s->header.count);
        if (packed > left)
            return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: stream %zu: %llu of %llu bytes", s->path, i,
                           (unsigned long long)left, (unsigned long long)packed);
        left -= packed;
    }
    if (left)
        sf_log(s->ctx, SF_LOG_WARNING, "%s: %llu bytes after the end ignored", s->path,
               (unsigned long long)left);
    return SF_OK;
}

static sf_status unpack_stream(const spz_in *s, size_t i, const uint8_t *data, size_t packed) {
    size_t bytes = (size_t)column_bytes(s, (sf_spz_column)i);
    uint8_t *to = s->body + (s->columns[i] - s->body);
    size_t got = ZSTD_decompress(to, bytes, data, packed);
    if (ZSTD_isError(got))
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: stream %zu: zstd: %s", s->path, i, ZSTD_getErrorName(got));
    return got == bytes ? SF_OK
                        : sf_fail(s->ctx, SF_ERR_FORMAT, "%s: stream %zu: unpacks to %zu of %zu bytes",
                                  s->path, i, got, bytes);
}

static sf_status unpack_streams(spz_in *s) {
    streams found = {0};
    sf_status status = find_streams(s, &found);
    if (!status) status = check_streams(s, &found);
    if (!status) status = allocate_body(s);
    sf_bytes b = {.data = s->data, .size = s->size, .at = found.table};
    for (size_t i = 0; i < found.number && !status; i++) {
        size_t packed = (size_t)sf_bytes_u64(&b);
        sf_bytes_u64(&b);
        status = unpack_stream(s, i, s->data + found.at, packed);
        found.at += packed;
    }
    return status;
}

#else

static sf_status unpack_streams(spz_in *s) {
    return sf_fail(s->ctx, SF_ERR_UNSUPPORTED,
                   "%s: version: 4 is packed by zstd, which this build is without", s->path);
}

#endif

/* ---- All ---- */

static sf_status unpack(spz_in *s) {
    if (!sf_spz_begins(s->data, s->size))
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: is not a .spz file: neither gzip nor NGSP", s->path);
    if (s->data[0] != 'N') return unpack_gzip(s);
    if (s->size < SF_SPZ_HEADER)
        return sf_fail(s->ctx, SF_ERR_FORMAT, "%s: truncated: %zu of the header's %d bytes", s->path, s->size,
                       STREAMS_HEADER);
    sf_status status = parse_header(s, s->data);
    if (!status && s->header.version < SF_SPZ_STREAMS)
        return refuse(s, SF_ERR_FORMAT, "version", s->header.version, "without gzip");
    return status ? status : unpack_streams(s);
}

/* Which axes to negate. A model's are right, down, front; less one, the number of a frame has a bit each for
 * right, up and front. */
static sf_status find_flips(const spz_in *s, const sf_model_file_options *options, unsigned *flips) {
    unsigned bits = s->axes - 1;
    *flips = SF_FLIP_Y | SF_FLIP_Z;
    if (options->spz_frame == SF_SPZ_FRAME_RUB) return SF_OK;
    *flips = 0;
    if (!s->axes) return SF_OK;
    if (s->axes > AXES_MOST) return refuse(s, SF_ERR_FORMAT, "axes", s->axes, "are not in 0..16");
    if (s->axes > AXES_READ)
        return refuse(s, SF_ERR_UNSUPPORTED, "axes", s->axes, "are a frame that is not read: 0 to 8 are");
    *flips = (bits & 1 ? 0u : SF_FLIP_X) | (bits & 2 ? SF_FLIP_Y : 0u) | (bits & 4 ? 0u : SF_FLIP_Z);
    return SF_OK;
}

static sf_status decode_all(const spz_in *s, int sh_degree, unsigned flips, sf_model_builder *in) {
    sf_gaussian g;
    sf_gaussians fields = sf_gaussian_fields(&g);
    sf_status status = SF_OK;
    for (size_t i = 0; i < s->header.count && !status; i++) {
        for (sf_spz_column c = SF_SPZ_MEANS; c < SF_SPZ_COLUMNS; c++)
            sf_spz_decode(&s->header, c, sh_degree, s->columns[c] + i * (size_t)sf_spz_width(&s->header, c),
                          &fields);
        sf_gaussian_flip(&g, sh_degree, flips);
        status = sf_model_builder_put(in, &g);
    }
    return status;
}

static sf_status make_model(const spz_in *s, const sf_model_file_options *options, sf_model **model) {
    sf_model_builder in = {0};
    unsigned flips;
    int kept = sf_file_degree(s->ctx, s->path, s->header.sh_degree, options);
    sf_status status = find_flips(s, options, &flips);
    if (!status) status = sf_model_builder_begin(&in, s->ctx, s->path, s->header.count, kept, options);
    if (!status) status = decode_all(s, kept, flips, &in);
    if (status)
        sf_model_builder_abandon(&in);
    else
        status = sf_model_builder_end(&in, s->header.antialiased, model);
    return status;
}

sf_status sf_spz_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model) {
    spz_in s = {.ctx = ctx, .path = path};
    uint8_t *data;
    sf_status status = sf_read_file(ctx, path, SF_MODEL_FILE_MOST, &data, &s.size);
    s.data = data;
    if (!status) status = unpack(&s);
    if (!status) status = make_model(&s, options, model);
    sf_free(ctx, s.body);
    sf_free(ctx, data);
    return status;
}
