/* colmap_find.c - the folder of the model in a project. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/bytes.h"
#include "../base/file.h"
#include "colmap.h"
#include "colmap_files.h"
#include "colmap_text.h"
#include "paths.h"

static uint64_t count_binary(const char *path) {
    uint8_t data[8];
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    sf_bytes b = {.data = data, .size = fread(data, 1, sizeof data, file)};
    fclose(file);
    return sf_bytes_u64(&b);
}

static sf_status count_text(sf_context *ctx, const char *path, uint64_t *count) {
    uint8_t *data;
    size_t size;
    sf_status status = sf_read_text(ctx, path, SF_COLMAP_MAX_BYTES, &data, &size);
    if (status) return status;
    *count = sf_colmap_count_lines((char *)data);
    sf_free(ctx, data);
    return SF_OK;
}

/* A file that cannot be read counts as empty: another model is better. */
static sf_status count_images(sf_context *ctx, const char *folder, uint64_t *count) {
    *count = 0;
    const char *name = sf_colmap_file_in(folder, &sf_colmap_images);
    if (!name) return SF_OK;
    char *path = sf_path_join(ctx, folder, name);
    if (!path) return SF_ERR_MEMORY;
    sf_status status = SF_OK;
    if (sf_colmap_is_text(path))
        status = count_text(ctx, path, count);
    else
        *count = count_binary(path);
    sf_free(ctx, path);
    return status == SF_ERR_MEMORY ? status : SF_OK;
}

typedef struct choice {
    char *folder; /* NULL: none yet */
    unsigned long number;
    uint64_t images;
    size_t models;
    int wanted; /* the number that must be taken; -1: any */
} choice;

/* Of models with as many images, the one with the lowest number: not the one that the file system lists
 * first. */
static int is_better(const choice *best, unsigned long number, uint64_t images) {
    return !best->folder || images > best->images || (images == best->images && number < best->number);
}

static sf_status consider(sf_context *ctx, const char *sparse, const char *name, choice *best) {
    if (name[strspn(name, "0123456789")] || strlen(name) > 9) return SF_OK;
    char *folder = sf_path_join(ctx, sparse, name);
    if (!folder) return SF_ERR_MEMORY;
    unsigned long number = strtoul(name, NULL, 10);
    uint64_t images = 0;
    int better = 0;
    sf_status status = SF_OK;
    if (sf_colmap_holds_model(folder)) {
        best->models++;
        status = count_images(ctx, folder, &images);
        better = !status &&
                 (best->wanted < 0 ? is_better(best, number, images) : number == (unsigned long)best->wanted);
    }
    if (!better) {
        sf_free(ctx, folder);
        return status;
    }
    sf_free(ctx, best->folder);
    *best = (choice){folder, number, images, best->models, best->wanted};
    return SF_OK;
}

static sf_status consider_all(sf_context *ctx, const char *sparse, DIR *folder, choice *best) {
    sf_status status = SF_OK;
    while (!status) {
        errno = 0;
        const struct dirent *entry = readdir(folder);
        if (!entry && errno)
            return sf_fail(ctx, SF_ERR_IO, "%s: cannot be read: %s", sparse, strerror(errno));
        if (!entry) return SF_OK;
        status = consider(ctx, sparse, entry->d_name, best);
    }
    return status;
}

static sf_status choose_model(sf_context *ctx, const char *sparse, int number, char **model) {
    DIR *folder = opendir(sparse);
    if (!folder) return SF_OK;
    choice best = {.wanted = number};
    sf_status status = consider_all(ctx, sparse, folder, &best);
    closedir(folder);
    if (!status && best.models && !best.folder)
        return sf_fail(ctx, SF_ERR_IO, "%s: sub_model: none of its %zu models is %d", sparse, best.models,
                       number);
    if (best.models > 1 && number < 0)
        sf_log(ctx, SF_LOG_INFO, "%s: of %zu models, %lu is taken: it has most images, %llu", sparse,
               best.models, best.number, (unsigned long long)best.images);
    *model = best.folder;
    return status;
}

sf_status sf_colmap_find(sf_context *ctx, const char *path, int number, char **model) {
    *model = NULL;
    char *sparse = sf_path_join(ctx, path, "sparse");
    if (!sparse) return SF_ERR_MEMORY;
    sf_status status = choose_model(ctx, sparse, number, model);
    const char *others[] = {sparse, path};
    for (int i = 0; i < 2 && !status && !*model; i++) {
        if (!sf_colmap_holds_model(others[i])) continue;
        *model = sf_text_copy(ctx, others[i]);
        if (!*model) status = SF_ERR_MEMORY;
    }
    if (status) {
        sf_free(ctx, *model);
        *model = NULL;
    }
    sf_free(ctx, sparse);
    return status;
}
