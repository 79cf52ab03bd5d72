/* repair.c - checksums that a mutation broke: behind them a parser sees what else changed. */
#include "fuzz.h"

#include <zlib.h>

#include "base/hash.h"
#include "io/sections.h"

static uint32_t big32(const uint8_t *p) {
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

/* A chunk: length, name, data, a sum of name and data. */
void fuzz_repair_png(uint8_t *data, size_t size) {
    enum { MAGIC = 8, AROUND = 12 };
    if (size < MAGIC || data[0] != 0x89) return;
    for (size_t at = MAGIC; size - at >= AROUND;) {
        uint8_t *chunk = data + at;
        size_t length = big32(chunk);
        if (length > size - at - AROUND) return;
        uint32_t sum = (uint32_t)crc32(0, chunk + 4, (uInt)(length + 4));
        for (int b = 0; b < 4; b++) chunk[8 + length + (size_t)b] = (uint8_t)(sum >> (24 - 8 * b));
        at += AROUND + length;
    }
}

static void store(uint8_t *to, uint64_t value, size_t bytes) {
    for (size_t b = 0; b < bytes; b++) to[b] = (uint8_t)(value >> (8 * b));
}

static uint64_t hash_in_pieces(const uint8_t *data, size_t size) {
    uint64_t hash = SF_HASH_SEED;
    for (size_t at = 0; at < size; at += SF_SECTION_PIECE)
        hash = sf_hash(hash, data + at, size - at < SF_SECTION_PIECE ? size - at : SF_SECTION_PIECE);
    return hash;
}

/* The layout is sections.h's. Where a section is said to be longer than the file, its last length stands. */
void fuzz_repair_sections(uint8_t *data, size_t size) {
    enum { FILE_HEADER = 24, COUNT_AT = SF_SECTION_NAME + 8, HEADER = SF_SECTION_NAME + 24, HASH = 8 };
    if (size < FILE_HEADER) return;
    store(data + FILE_HEADER - HASH, sf_hash(SF_HASH_SEED, data, FILE_HEADER - HASH), HASH);
    for (size_t at = FILE_HEADER; size - at >= HEADER + HASH;) {
        uint8_t *header = data + at;
        sf_bytes b = {.data = header, .size = HEADER, .at = SF_SECTION_NAME};
        size_t left = size - at - HEADER - HASH, element = sf_bytes_u32(&b);
        b.at = COUNT_AT;
        uint64_t count = sf_bytes_u64(&b);
        if (!element || element > 8) return;
        if (count > left / element) store(header + COUNT_AT, count = left / element, 8);
        store(header + HEADER - HASH, sf_hash(SF_HASH_SEED, header, HEADER - HASH), HASH);
        size_t bytes = (size_t)count * element;
        store(header + HEADER + bytes, hash_in_pieces(header + HEADER, bytes), HASH);
        at += HEADER + bytes + HASH;
    }
}
