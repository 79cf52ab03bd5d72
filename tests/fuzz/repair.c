/* repair.c - checksums that a mutation broke: behind them a parser sees what else changed. */
#include "fuzz.h"

#include <zlib.h>

#include "base/hash.h"

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

void fuzz_store(uint8_t *to, uint64_t value, size_t bytes) {
    for (size_t b = 0; b < bytes; b++) to[b] = (uint8_t)(value >> (8 * b));
}

static uint64_t hash_in_pieces(const uint8_t *data, size_t size) {
    uint64_t hash = SF_HASH_SEED;
    for (size_t at = 0; at < size; at += SF_SECTION_PIECE)
        hash = sf_hash(hash, data + at, size - at < SF_SECTION_PIECE ? size - at : SF_SECTION_PIECE);
    return hash;
}

enum { COUNT_AT = SF_SECTION_NAME + 8 }; /* in a section's header */

int fuzz_section_at(const uint8_t *data, size_t size, size_t at, fuzz_section *s) {
    if (size < at || size - at < FUZZ_SECTION_HEADER + FUZZ_SECTION_HASH) return 0;
    sf_bytes b = {.data = data, .size = size, .at = at + SF_SECTION_NAME};
    size_t most = size - at - FUZZ_SECTION_HEADER - FUZZ_SECTION_HASH;
    s->at = at;
    s->element = sf_bytes_u32(&b);
    b.at = at + COUNT_AT;
    uint64_t count = sf_bytes_u64(&b);
    if (!s->element || s->element > 8) return 0;
    s->count = count > most / s->element ? most / s->element : (size_t)count;
    return 1;
}

size_t fuzz_section_end(const fuzz_section *s) {
    return s->at + FUZZ_SECTION_HEADER + s->element * s->count + FUZZ_SECTION_HASH;
}

/* Where a section is said to be longer than the file, its last length stands. */
void fuzz_repair_sections(uint8_t *data, size_t size) {
    fuzz_section s;
    if (size < FUZZ_FILE_HEADER) return;
    fuzz_store(data + FUZZ_FILE_HEADER - FUZZ_SECTION_HASH,
               sf_hash(SF_HASH_SEED, data, FUZZ_FILE_HEADER - FUZZ_SECTION_HASH), FUZZ_SECTION_HASH);
    for (size_t at = FUZZ_FILE_HEADER; fuzz_section_at(data, size, at, &s); at = fuzz_section_end(&s)) {
        uint8_t *header = data + at;
        size_t bytes = s.count * s.element;
        fuzz_store(header + COUNT_AT, s.count, 8);
        fuzz_store(header + FUZZ_SECTION_HEADER - FUZZ_SECTION_HASH,
                   sf_hash(SF_HASH_SEED, header, FUZZ_SECTION_HEADER - FUZZ_SECTION_HASH), FUZZ_SECTION_HASH);
        fuzz_store(header + FUZZ_SECTION_HEADER + bytes, hash_in_pieces(header + FUZZ_SECTION_HEADER, bytes),
                   FUZZ_SECTION_HASH);
    }
}

void fuzz_edit_sections(uint8_t *data, size_t size, unsigned seed) {
    static const uint64_t odd[] = {0,
                                   1,
                                   2,
                                   0x7f800000,
                                   0x7fffffff,
                                   0xffffffff,
                                   0x100000000,
                                   0x7fffffffffffffff,
                                   0xffffffffffffffff,
                                   0x43e158e460913d00 /* 1e19 */,
                                   0x7fe1ccf385ebc8a0 /* 1e308 */,
                                   0x7ff0000000000000 /* infinity */};
    fuzz_section s, chosen = {0};
    unsigned sections = 0;
    for (size_t at = FUZZ_FILE_HEADER; fuzz_section_at(data, size, at, &s);
         at = fuzz_section_end(&s), sections += s.element > 1)
        ;
    unsigned wanted = sections ? seed % sections : 0;
    for (size_t at = FUZZ_FILE_HEADER; fuzz_section_at(data, size, at, &s); at = fuzz_section_end(&s))
        if (s.element > 1 && !wanted--) chosen = s;
    if (!chosen.count) return;
    size_t element = seed / 64 % chosen.count;
    fuzz_store(data + chosen.at + FUZZ_SECTION_HEADER + element * chosen.element,
               odd[seed / 4096 % (sizeof odd / sizeof *odd)], chosen.element);
}
