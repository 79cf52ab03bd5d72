/* photo_note.c - which photos cameras were found of, noted as text and compared later. */
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"
#include "../io/copies.h"
#include "../io/paths.h"
#include "photo_folder.h"

#include <splatfit/sfm.h>

enum { MOST_BYTES = 1 << 28 /* of a note */ };

typedef struct noted {
    char kind; /* 'c': a file of cameras; 'p': a photo */
    uint64_t size, hash;
    char *name;
} noted;

typedef struct note {
    sf_context *ctx;
    const char *folder; /* that the names are in */
    char kind;
    noted *files;
    size_t count, room;
    sf_status status;
} note;

static void free_note(note *n) {
    for (size_t i = 0; i < n->count; i++) sf_free(n->ctx, n->files[i].name);
    sf_free(n->ctx, n->files);
}

static sf_status add(note *n, const noted *file, const char *name) {
    sf_status status = sf_grow(n->ctx, &n->files, &n->room, n->count, n->count + 1, sizeof *n->files);
    if (status) return status;
    noted *to = &n->files[n->count];
    *to = *file;
    to->name = sf_text_copy(n->ctx, name);
    if (!to->name) return SF_ERR_MEMORY;
    for (char *c = to->name; *c; c++)
        if ((unsigned char)*c < ' ') *c = '?'; /* a name is a line */
    n->count++;
    return SF_OK;
}

static int add_file(void *user, const char *name) {
    note *n = user;
    noted file = {.kind = n->kind};
    char *path = sf_path_join(n->ctx, n->folder, name);
    if (path) {
        sf_file_mark mark = sf_mark_file(path);
        file.size = mark.size, file.hash = mark.hash;
    }
    n->status = path ? add(n, &file, name) : SF_ERR_MEMORY;
    sf_free(n->ctx, path);
    return n->status != SF_OK;
}

static int by_name(const void *a, const void *b) {
    const noted *x = a, *y = b;
    return x->kind != y->kind ? x->kind - y->kind : strcmp(x->name, y->name);
}

static void sort(note *n) {
    if (n->count) qsort(n->files, n->count, sizeof *n->files, by_name);
}

/* What is there now. A video's name does not count: it may be renamed. */
static sf_status see(note *n, const char *photos, const char *cameras) {
    static const char *const files[] = {"cameras.bin", "images.bin", "points3D.bin"};
    n->kind = 'p', n->folder = photos;
    if (photos && sf_is_folder(photos)) {
        sf_photo_folder_walk(photos, add_file, n);
    } else if (photos) {
        noted video = {.kind = 'p'};
        sf_file_mark mark = sf_mark_file(photos);
        video.size = mark.size, video.hash = mark.hash;
        n->status = add(n, &video, "video");
    }
    n->kind = 'c', n->folder = cameras;
    for (size_t i = 0; cameras && i < 3 && !n->status; i++) add_file(n, files[i]);
    sort(n);
    return n->status;
}

sf_status sf_sfm_note_photos(sf_context *ctx, const char *photos, const char *cameras, const char *path) {
    note now = {.ctx = ctx};
    sf_writer w;
    sf_status status = see(&now, photos, cameras);
    if (!status) status = sf_writer_open(&w, ctx, path);
    if (!status) {
        sf_writer_printf(&w, "# splatfit: cameras (c) and what they were found of (p): bytes, hash, name\n");
        for (size_t i = 0; i < now.count; i++)
            sf_writer_printf(&w, "%c %" PRIu64 " %016" PRIx64 " %s\n", now.files[i].kind, now.files[i].size,
                             now.files[i].hash, now.files[i].name);
        status = sf_writer_commit(&w);
    }
    free_note(&now);
    return status;
}

/* 1 where the line says a file. */
static int read_line(note *n, const char *line) {
    noted file;
    int at = 0;
    if (sscanf(line, "%c %" SCNu64 " %" SCNx64 " %n", &file.kind, &file.size, &file.hash, &at) != 3 || !at)
        return 0;
    if (file.kind != 'c' && file.kind != 'p') return 0;
    n->status = add(n, &file, line + at);
    return !n->status;
}

/* *is_noted 0: there is no note, or it is none of these. */
static sf_status read_note(note *n, const char *path, int *is_noted) {
    uint8_t *data;
    size_t size;
    *is_noted = 0;
    if (!sf_is_file(path)) return SF_OK;
    sf_status status = sf_read_text(n->ctx, path, MOST_BYTES, &data, &size);
    if (status) return status;
    *is_noted = 1;
    for (char *line = (char *)data; *line && *is_noted;) {
        size_t length = strcspn(line, "\n");
        char *next = line + length + (line[length] == '\n');
        line[length] = 0;
        if (*line != '#') *is_noted = read_line(n, line);
        line = next;
    }
    sf_free(n->ctx, data);
    sort(n);
    return n->status;
}

static void compare(const note *before, const note *now, sf_photos_change *change) {
    size_t i = 0, k = 0;
    while (i < before->count || k < now->count) {
        const noted *x = i < before->count ? &before->files[i] : NULL,
                    *y = k < now->count ? &now->files[k] : NULL;
        int order = !x ? 1 : !y ? -1 : by_name(x, y);
        int differs = order || x->size != y->size || x->hash != y->hash;
        char kind = order > 0 ? y->kind : x->kind;
        i += order <= 0, k += order >= 0;
        if (!differs) continue;
        if (kind == 'c')
            change->other_cameras = 1;
        else
            ++*(order < 0 ? &change->removed : order > 0 ? &change->added : &change->replaced);
    }
}

sf_status sf_sfm_compare_photos(sf_context *ctx, const char *photos, const char *cameras, const char *path,
                                sf_photos_change *change) {
    note before = {.ctx = ctx}, now = {.ctx = ctx};
    *change = (sf_photos_change){0};
    sf_status status = read_note(&before, path, &change->noted);
    if (!status && change->noted) status = see(&now, photos, cameras);
    if (!status && change->noted) compare(&before, &now, change);
    free_note(&before);
    free_note(&now);
    return status;
}
