/* sections.c - a file of named arrays, each with a checksum. */
#include "sections.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../base/bytes.h"
#include "../base/hash.h"
#include "../base/memory.h"

enum { FILE_HEADER = 24, SECTION_HEADER = SF_SECTION_NAME + 24, HASH_BYTES = 8, MAGIC_BYTES = 8 };

static const char end_name[] = "end";

/* The first and the last byte of an unsigned value change places with the machine's order. */
static int is_big_endian(void) {
    const uint16_t one = 1;
    uint8_t first;
    memcpy(&first, &one, 1);
    return !first;
}

/* Elements of the machine's order to the file's, or back. */
static void reorder(uint8_t *bytes, size_t length, size_t size) {
    if (size == 1 || !is_big_endian()) return;
    for (uint8_t *p = bytes; p < bytes + length; p += size)
        for (size_t i = 0; i < size / 2; i++) {
            uint8_t keep = p[i];
            p[i] = p[size - 1 - i];
            p[size - 1 - i] = keep;
        }
}

static void store(uint8_t *to, uint64_t value, size_t bytes) {
    for (size_t i = 0; i < bytes; i++) to[i] = (uint8_t)(value >> (8 * i));
}

/* Writing. */

static void put_hash(sf_writer *w, uint64_t hash) {
    uint8_t bytes[HASH_BYTES];
    store(bytes, hash, sizeof bytes);
    sf_writer_put(w, bytes, sizeof bytes);
}

static void put_with_hash(sf_writer *w, const uint8_t *bytes, size_t size) {
    sf_writer_put(w, bytes, size);
    put_hash(w, sf_hash(SF_HASH_SEED, bytes, size));
}

sf_status sf_sections_create(sf_sections_out *out, sf_context *ctx, const char *path,
                             const sf_sections_kind *kind) {
    uint8_t header[FILE_HEADER - HASH_BYTES] = {0};
    out->count = 0;
    sf_status status = sf_writer_open(&out->writer, ctx, path);
    if (status) return status;
    memcpy(header, kind->magic, MAGIC_BYTES);
    store(header + MAGIC_BYTES, kind->version, 4);
    put_with_hash(&out->writer, header, sizeof header);
    return SF_OK;
}

void sf_sections_put_from(sf_sections_out *out, const char *name, sf_section_source source, const void *user,
                          size_t count, size_t size) {
    uint8_t header[SECTION_HEADER - HASH_BYTES] = {0};
    _Alignas(8) uint8_t piece[SF_SECTION_PIECE];
    memcpy(header, name, strlen(name));
    store(header + SF_SECTION_NAME, size, 4);
    store(header + SF_SECTION_NAME + 8, count, 8);
    put_with_hash(&out->writer, header, sizeof header);
    uint64_t hash = SF_HASH_SEED;
    for (size_t first = 0, most = sizeof piece / size; first < count; first += most) {
        size_t n = count - first < most ? count - first : most;
        source(user, first, n, piece);
        reorder(piece, n * size, size);
        hash = sf_hash(hash, piece, n * size);
        sf_writer_put(&out->writer, piece, n * size);
    }
    put_hash(&out->writer, hash);
    out->count++;
}

typedef struct array {
    const uint8_t *values;
    size_t size; /* of an element */
} array;

static void copy_from_array(const void *user, size_t first, size_t count, void *to) {
    const array *from = user;
    memcpy(to, from->values + first * from->size, count * from->size);
}

void sf_sections_put(sf_sections_out *out, const char *name, const void *values, size_t count, size_t size) {
    sf_sections_put_from(out, name, copy_from_array, &(array){values, size}, count, size);
}

sf_status sf_sections_commit(sf_sections_out *out) {
    uint64_t count = out->count;
    sf_sections_put(out, end_name, &count, 1, sizeof count);
    return sf_writer_commit(&out->writer);
}

/* Reading. */

static sf_status damaged(const sf_sections_in *in, const char *section, const char *what) {
    return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: %s", in->path, section, what);
}

/* `size` bytes at `at`; *whole is 0 where the file ends before them. */
static sf_status read_at(const sf_sections_in *in, uint64_t at, uint8_t *data, size_t size, int *whole) {
    size_t got = 0;
    while (got < size) {
        ssize_t n = pread(in->fd, data + got, size - got, (off_t)(at + got));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return sf_fail(in->ctx, SF_ERR_IO, "%s: cannot be read: %s", in->path, strerror(errno));
        if (n == 0) break;
        got += (size_t)n;
    }
    *whole = got == size;
    return SF_OK;
}

static int hash_matches(const uint8_t *bytes, size_t size) {
    sf_bytes b = {.data = bytes + size, .size = HASH_BYTES};
    return sf_bytes_u64(&b) == sf_hash(SF_HASH_SEED, bytes, size);
}

static sf_status read_header(const sf_sections_in *in, const sf_sections_kind *kind) {
    uint8_t header[FILE_HEADER];
    int whole;
    sf_status status = read_at(in, 0, header, sizeof header, &whole);
    if (status) return status;
    if (!whole || memcmp(header, kind->magic, MAGIC_BYTES))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: is not %s", in->path, kind->text);
    if (!hash_matches(header, FILE_HEADER - HASH_BYTES))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: header: is damaged: its checksum differs", in->path);
    sf_bytes b = {.data = header, .size = sizeof header, .at = MAGIC_BYTES};
    uint32_t version = sf_bytes_u32(&b);
    if (version != kind->version)
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: version: %u, this program reads %u", in->path,
                       (unsigned)version, (unsigned)kind->version);
    return SF_OK;
}

/* The section whose header is at *at; *at moves on to the next. */
static sf_status read_section(sf_sections_in *in, uint64_t size, uint64_t *at) {
    uint8_t header[SECTION_HEADER];
    int whole;
    sf_section *s = &in->sections[in->count];
    sf_status status = read_at(in, *at, header, sizeof header, &whole);
    if (status) return status;
    if (!whole)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: is cut off after %zu sections", in->path, in->count);
    if (!hash_matches(header, SECTION_HEADER - HASH_BYTES))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %zu: is damaged: its header's checksum differs",
                       in->path, in->count + 1);
    sf_bytes b = {.data = header, .size = sizeof header, .at = SF_SECTION_NAME};
    memcpy(s->name, header, SF_SECTION_NAME);
    s->name[SF_SECTION_NAME] = 0;
    s->element = sf_bytes_u32(&b);
    sf_bytes_u32(&b);
    s->count = sf_bytes_u64(&b);
    s->at = *at + SECTION_HEADER;
    s->taken = 0;
    uint64_t left = size > s->at ? size - s->at : 0;
    if (s->element != 1 && s->element != 2 && s->element != 4 && s->element != 8)
        return damaged(in, s->name, "elements are not of 1, 2, 4 or 8 bytes");
    if (left < HASH_BYTES || s->count > (left - HASH_BYTES) / s->element)
        return damaged(in, s->name, "is cut off");
    *at = s->at + s->count * s->element + HASH_BYTES;
    in->count++;
    return SF_OK;
}

/* All sections up to "end", which is checked and left out. */
static sf_status read_table(sf_sections_in *in) {
    struct stat st;
    if (fstat(in->fd, &st))
        return sf_fail(in->ctx, SF_ERR_IO, "%s: cannot be read: %s", in->path, strerror(errno));
    uint64_t size = (uint64_t)st.st_size, at = FILE_HEADER, count = 0;
    do {
        if (in->count == SF_SECTIONS_MOST)
            return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: more than %d sections", in->path, SF_SECTIONS_MOST);
        sf_status status = read_section(in, size, &at);
        if (status) return status;
    } while (strcmp(in->sections[in->count - 1].name, end_name));
    sf_status status = sf_sections_take(in, end_name, &count, 1, sizeof count);
    if (status) return status;
    in->count--;
    if (count != in->count)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: sections: %zu, not the %llu announced", in->path,
                       in->count, (unsigned long long)count);
    if (at != size)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: size: %llu bytes more than its sections", in->path,
                       (unsigned long long)(size - at));
    return SF_OK;
}

sf_status sf_sections_open(sf_sections_in *in, sf_context *ctx, const char *path,
                           const sf_sections_kind *kind) {
    *in = (sf_sections_in){.ctx = ctx, .path = path};
    /* Not blocking: a pipe is refused, not waited for. */
    in->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (in->fd < 0) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    struct stat st;
    sf_status status = SF_OK;
    if (fstat(in->fd, &st) || !S_ISREG(st.st_mode))
        status = sf_fail(ctx, SF_ERR_IO, "%s: is not a regular file", path);
    if (!status) status = read_header(in, kind);
    if (!status) status = read_table(in);
    if (status) sf_sections_close(in);
    return status;
}

void sf_sections_close(sf_sections_in *in) {
    if (in->fd >= 0) close(in->fd);
    in->fd = -1;
}

/* Index of a section; in->count: no such section. */
static size_t find(const sf_sections_in *in, const char *name) {
    size_t i = 0;
    while (i < in->count && strcmp(in->sections[i].name, name)) i++;
    return i;
}

sf_status sf_sections_count(const sf_sections_in *in, const char *name, size_t size, uint64_t *count) {
    const sf_section *s = &in->sections[find(in, name)];
    *count = 0;
    if (s == in->sections + in->count) return damaged(in, name, "is missing");
    if (s->element != size)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: elements of %u bytes, not of %zu", in->path,
                       name, (unsigned)s->element, size);
    *count = s->count;
    return SF_OK;
}

sf_status sf_sections_take(sf_sections_in *in, const char *name, void *values, size_t count, size_t size) {
    uint64_t have, hash = SF_HASH_SEED;
    sf_status status = sf_sections_count(in, name, size, &have);
    if (status) return status;
    if (have != count)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: %llu elements, not %zu", in->path, name,
                       (unsigned long long)have, count);
    sf_section *s = &in->sections[find(in, name)];
    uint8_t *to = values, stored[HASH_BYTES];
    uint64_t at = s->at;
    int whole = 1;
    for (size_t left = count * size; left && whole;) {
        size_t n = left < SF_SECTION_PIECE ? left : SF_SECTION_PIECE;
        status = read_at(in, at, to, n, &whole);
        if (status) return status;
        hash = sf_hash(hash, to, n);
        reorder(to, n, size);
        to += n;
        at += n;
        left -= n;
    }
    if (whole) status = read_at(in, at, stored, sizeof stored, &whole);
    if (status) return status;
    sf_bytes b = {.data = stored, .size = sizeof stored};
    if (!whole || sf_bytes_u64(&b) != hash) return damaged(in, name, "is damaged: its checksum differs");
    s->taken = 1;
    return SF_OK;
}

sf_status sf_sections_take_new(sf_sections_in *in, const char *name, void *block_pointer, size_t *count,
                               size_t most, size_t size) {
    uint64_t have;
    sf_status status = sf_sections_count(in, name, size, &have);
    if (status) return status;
    if (have > most)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: %llu elements are more than %zu", in->path,
                       name, (unsigned long long)have, most);
    status = sf_memory_check(in->ctx, in->path, name, have * size);
    if (status) return status;
    void *block = sf_alloc(in->ctx, (size_t)have, size);
    if (!block) return SF_ERR_MEMORY;
    status = sf_sections_take(in, name, block, (size_t)have, size);
    if (status) {
        sf_free(in->ctx, block);
        return status;
    }
    memcpy(block_pointer, &block, sizeof block);
    *count = (size_t)have;
    return SF_OK;
}

sf_status sf_sections_all_taken(const sf_sections_in *in) {
    for (size_t i = 0; i < in->count; i++)
        if (!in->sections[i].taken)
            return sf_fail(in->ctx, SF_ERR_UNSUPPORTED, "%s: section %s: is not known to this program",
                           in->path, in->sections[i].name);
    return SF_OK;
}
