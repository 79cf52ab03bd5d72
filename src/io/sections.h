/* sections.h - a file of named arrays, each with a checksum: what checkpoints are kept in.
 *
 *     header   magic [8], version u32, 0 u32, hash u64 of these 16 bytes
 *     section  name [24] padded with 0s, bytes of an element u32, 0 u32, count u64, hash u64 of these 40
 * bytes; the elements; hash u64 of the elements, SF_SECTION_PIECE bytes a step
 *     ...
 *     section  "end", one u64: the number of sections before it
 *
 * All little-endian. Nothing follows "end".
 */
#ifndef SF_IO_SECTIONS_H
#define SF_IO_SECTIONS_H

#include "../base/file.h"

enum { SF_SECTION_NAME = 24, SF_SECTIONS_MOST = 128, SF_SECTION_PIECE = 1 << 15 };

/* What kind of file it is. */
typedef struct sf_sections_kind {
    const char *magic; /* 8 characters */
    uint32_t version;
    const char *text; /* for messages, for example "a checkpoint" */
} sf_sections_kind;

/* Writing: whole or not at all, as sf_writer. */
typedef struct sf_sections_out {
    sf_writer writer;
    uint64_t count;
} sf_sections_out;

sf_status sf_sections_create(sf_sections_out *out, sf_context *ctx, const char *path,
                             const sf_sections_kind *kind);
/* Appends `count` elements of `size` bytes: 1, 2, 4 or 8. Failures show in the commit. */
void sf_sections_put(sf_sections_out *out, const char *name, const void *values, size_t count, size_t size);
/* The same of elements that are made as they are written: `source` puts elements first .. first+count-1 into
 * `to`, which is aligned for them. */
typedef void (*sf_section_source)(const void *user, size_t first, size_t count, void *to);
void sf_sections_put_from(sf_sections_out *out, const char *name, sf_section_source source, const void *user,
                          size_t count, size_t size);
sf_status sf_sections_commit(sf_sections_out *out);

/* Reading. */
typedef struct sf_section {
    char name[SF_SECTION_NAME + 1];
    uint32_t element; /* bytes */
    uint64_t count;
    uint64_t at; /* of the first element in the file */
    int taken;
} sf_section;

typedef struct sf_sections_in {
    sf_context *ctx;
    const char *path; /* the caller's */
    int fd;
    size_t count;
    sf_section sections[SF_SECTIONS_MOST + 1];
} sf_sections_in;

/* Opens a file and reads where its sections are. SF_ERR_IO: cannot be read; SF_ERR_FORMAT: is no such file,
 * is damaged; SF_ERR_UNSUPPORTED: of another version. `path` must stand until the close. */
sf_status sf_sections_open(sf_sections_in *in, sf_context *ctx, const char *path,
                           const sf_sections_kind *kind);
/* Elements of a section; SF_ERR_FORMAT, naming it: the section is missing or its elements have another size.
 */
sf_status sf_sections_count(const sf_sections_in *in, const char *name, size_t size, uint64_t *count);
/* Reads a section that must have `count` elements of `size` bytes. SF_ERR_FORMAT, naming it: it is missing,
 * has another size, is damaged. */
sf_status sf_sections_take(sf_sections_in *in, const char *name, void *values, size_t count, size_t size);
/* The same into new memory, sf_free'd by the caller, of at most `most` elements. */
sf_status sf_sections_take_new(sf_sections_in *in, const char *name, void *block_pointer, size_t *count,
                               size_t most, size_t size);
/* SF_ERR_UNSUPPORTED, naming the section, if one was not taken: a state that nobody knows cannot be gone on
 * from. */
sf_status sf_sections_all_taken(const sf_sections_in *in);
void sf_sections_close(sf_sections_in *in);

#endif
