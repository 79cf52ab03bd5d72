/* copies.c - see copies.h. */
#include "copies.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "../base/context.h"
#include "../base/hash.h"
#include "../base/memory.h"

enum { END_BYTES = 1 << 16 };

sf_file_mark sf_mark_file(const char *path) {
    uint8_t bytes[END_BYTES];
    sf_file_mark mark = {0, SF_HASH_SEED};
    FILE *f = fopen(path, "rb");
    if (!f) return mark;
    mark.hash = sf_hash(mark.hash, bytes, fread(bytes, 1, sizeof bytes, f));
    long size = fseek(f, 0, SEEK_END) ? 0 : ftell(f);
    mark.size = size > 0 ? (uint64_t)size : 0;
    if (size > END_BYTES && !fseek(f, size - END_BYTES, SEEK_SET))
        mark.hash = sf_hash(mark.hash, bytes, fread(bytes, 1, sizeof bytes, f));
    fclose(f);
    return mark;
}

typedef struct sized {
    uint64_t size;
    const sf_entry *entry;
} sized;

static int by_size(const void *a, const void *b) {
    const sized *x = a, *y = b;
    if (x->size != y->size) return x->size < y->size ? -1 : 1;
    return x->entry < y->entry ? -1 : x->entry > y->entry; /* by name, as the project is sorted */
}

/* The training picture of files[0..n-1], which have one size, that a held-out one is a copy of; NULL: none. A
 * file that another view uses, too, is not a copy. */
static const sf_entry *original_of(const sized *files, size_t n, const sf_entry *held_out) {
    sf_file_mark mark = sf_mark_file(held_out->path);
    for (size_t i = 0; i < n; i++) {
        const sf_entry *other = files[i].entry;
        if (other->split == SF_SPLIT_TEST) continue;
        sf_file_mark of_other = sf_mark_file(other->path);
        if (of_other.size == mark.size && of_other.hash == mark.hash) return other;
    }
    return NULL;
}

sf_status sf_warn_of_copies(const sf_project *p) {
    sized *files = sf_alloc(p->ctx, p->count, sizeof *files);
    if (!files) return SF_ERR_MEMORY;
    size_t copies = 0;
    const sf_entry *copy = NULL, *original = NULL;
    for (size_t i = 0; i < p->count; i++) {
        struct stat st;
        files[i] = (sized){stat(p->entries[i].path, &st) ? 0 : (uint64_t)st.st_size, &p->entries[i]};
    }
    qsort(files, p->count, sizeof *files, by_size);
    for (size_t from = 0, end; from < p->count; from = end) {
        for (end = from + 1; end < p->count && files[end].size == files[from].size;) end++;
        for (size_t i = from; i < end && files[from].size && end - from > 1; i++) {
            const sf_entry *found = files[i].entry->split == SF_SPLIT_TEST
                                        ? original_of(files + from, end - from, files[i].entry)
                                        : NULL;
            if (found && !copies++) copy = files[i].entry, original = found;
        }
    }
    sf_free(p->ctx, files);
    if (copies)
        sf_log(p->ctx, SF_LOG_WARNING,
               "%s: %zu held-out pictures are copies of training pictures (%s of %s): their quality says "
               "nothing of new views; remove the copies",
               p->path, copies, copy->name, original->name);
    return SF_OK;
}
