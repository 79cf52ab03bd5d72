/* dataset.c - the pictures and cameras of a project, and which of them are held out. */
#include "dataset.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"
#include "paths.h"

static const uint64_t MAX_LIST_BYTES = 1 << 28;

static const char *without_dot(const char *name) {
    while (!strncmp(name, "./", 2)) name += 2;
    return name;
}

void sf_project_free(sf_project *p) {
    for (size_t i = 0; i < p->count; i++) {
        sf_free(p->ctx, p->entries[i].name);
        sf_free(p->ctx, p->entries[i].path);
        sf_free(p->ctx, p->entries[i].mask);
    }
    sf_free(p->ctx, p->entries);
    sf_free(p->ctx, p->xyz);
    sf_free(p->ctx, p->rgb);
    sf_free(p->ctx, p->folder);
}

sf_status sf_project_set_folder(sf_project *p, const char *folder) {
    sf_free(p->ctx, p->folder);
    p->folder = sf_text_copy(p->ctx, folder);
    return p->folder ? SF_OK : SF_ERR_MEMORY;
}

static void turn_slashes(char *name) {
    for (; *name; name++)
        if (*name == '\\') *name = '/';
}

char *sf_plain_name(sf_context *ctx, const char *folder, const char *name) {
    char *plain = sf_text_copy(ctx, name);
    if (plain && strchr(name, '\\') && !sf_holds_file(folder, name)) turn_slashes(plain);
    return plain;
}

static sf_status add_plain(sf_project *p, const char *file, const char *folder, const char *name,
                           sf_entry **entry) {
    if (!sf_name_stays_inside(name))
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: picture name: '%s' is not a path inside its folder", file,
                       name);
    sf_status status = sf_grow(p->ctx, &p->entries, &p->capacity, p->count, p->count + 1, sizeof *p->entries);
    if (status) return status;
    sf_entry *e = &p->entries[p->count++];
    *e = (sf_entry){.name = sf_text_copy(p->ctx, without_dot(name)),
                    .path = sf_path_join(p->ctx, folder, name)};
    *entry = e;
    return e->name && e->path ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_entry_complete(sf_context *ctx, sf_entry *e, const char *const *endings) {
    for (; *endings; endings++) {
        size_t size = strlen(e->path) + strlen(*endings) + 1;
        char *path = sf_alloc(ctx, size, 1);
        if (!path) return SF_ERR_MEMORY;
        snprintf(path, size, "%s%s", e->path, *endings);
        if (sf_is_file(path)) {
            sf_free(ctx, e->path);
            e->path = path;
            return SF_OK;
        }
        sf_free(ctx, path);
    }
    return SF_OK;
}

sf_status sf_project_add(sf_project *p, const char *file, const char *folder, const char *name,
                         sf_entry **entry) {
    char *plain = sf_plain_name(p->ctx, folder, name);
    sf_status status = plain ? add_plain(p, file, folder, plain, entry) : SF_ERR_MEMORY;
    sf_free(p->ctx, plain);
    return status;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const sf_entry *)a)->name, ((const sf_entry *)b)->name);
}

sf_status sf_project_sort(sf_project *p, const char *file) {
    if (p->count) qsort(p->entries, p->count, sizeof *p->entries, by_name);
    for (size_t i = 1; i < p->count; i++)
        if (!by_name(&p->entries[i - 1], &p->entries[i]))
            return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: picture name: '%s' appears twice", file,
                           p->entries[i].name);
    return SF_OK;
}

static int name_of_entry(const void *name, const void *entry) {
    return strcmp(name, ((const sf_entry *)entry)->name);
}

sf_entry *sf_project_find(const sf_project *p, const char *name) {
    if (!p->count) return NULL;
    return bsearch(without_dot(name), p->entries, p->count, sizeof *p->entries, name_of_entry);
}

/* The split. */

static int name_of_text(const void *name, const void *text) {
    return strcmp(name, *(const char *const *)text);
}

static int is_last_part(const char *name, const char *part) {
    const char *slash = strrchr(name, '/');
    return !strcmp(slash ? slash + 1 : name, part);
}

/* How many names the line holds out. */
static size_t hold_out_line(const char *line, size_t count, const char *const *names, sf_split *splits) {
    const char *const *same = bsearch(line, names, count, sizeof *names, name_of_text);
    if (same) {
        splits[same - names] = SF_SPLIT_TEST;
        return 1;
    }
    size_t found = 0;
    for (size_t i = 0; i < count; i++) {
        if (!is_last_part(names[i], line)) continue;
        splits[i] = SF_SPLIT_TEST;
        found++;
    }
    return found;
}

/* The line with '/' for '\\'. */
static size_t hold_out_plain(char *line, size_t count, const char *const *names, sf_split *splits) {
    if (!strchr(line, '\\')) return 0;
    turn_slashes(line);
    return hold_out_line(without_dot(line), count, names, splits);
}

static sf_status hold_out_lines(sf_context *ctx, const char *path, char *text, size_t count,
                                const char *const *names, sf_split *splits) {
    for (unsigned long number = 1; *text; number++) {
        size_t length = strcspn(text, "\n");
        char *line = text;
        text += length + (text[length] == '\n');
        while (length && strchr(" \t\r", line[length - 1])) length--;
        line[length] = 0;
        if (length && !hold_out_line(without_dot(line), count, names, splits) &&
            !hold_out_plain(line, count, names, splits))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: line %lu: no picture is named '%s'", path, number,
                           line);
    }
    return SF_OK;
}

static sf_status split_by_list(sf_context *ctx, const char *path, size_t count, const char *const *names,
                               sf_split *splits) {
    uint8_t *text;
    size_t size;
    sf_status status = sf_read_text(ctx, path, MAX_LIST_BYTES, &text, &size);
    if (status) return status;
    for (size_t i = 0; i < count; i++) splits[i] = SF_SPLIT_TRAIN;
    status = hold_out_lines(ctx, path, (char *)text, count, names, splits);
    sf_free(ctx, text);
    return status;
}

sf_status sf_split_names(sf_context *ctx, const sf_load_options *options, size_t count,
                         const char *const *names, sf_split *splits) {
    if (options->test_list) return split_by_list(ctx, options->test_list, count, names, splits);
    for (size_t i = 0; i < count; i++)
        splits[i] = options->hold_out && i % (size_t)options->hold_out == 0 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN;
    return SF_OK;
}

/* What others ask. */

int sf_holds_project(const char *folder) {
    static const char *const files[] = {"cameras.bin",         "cameras.txt",
                                        "transforms.json",     "transforms_train.json",
                                        "reconstruction.json", "opensfm/reconstruction.json"};
    static const char *const folders[] = {"sparse", "keyframes/corrected_cameras", "keyframes/cameras"};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        if (sf_holds_file(folder, files[i])) return 1;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++)
        if (sf_holds_folder(folder, folders[i])) return 1;
    return 0;
}

int sf_is_same_shape(int width, int height, int of_width, int of_height) {
    double x = (double)width / of_width, y = (double)height / of_height;
    return fabs(height - x * of_height) <= fmax(x, 1) || fabs(width - y * of_width) <= fmax(y, 1);
}

sf_status sf_load_cancelled(sf_context *ctx, const char *path) {
    return sf_fail(ctx, SF_ERR_CANCELLED, "%s: reading it was cancelled", path);
}
