/* frame_pictures.c - see frame_pictures.h. */
#include "frame_pictures.h"

#include <string.h>

#include "paths.h"

static const char usual[] = "images/";

static sf_status holds_folder(sf_context *ctx, const char *folder, const char *name, int *there) {
    char *path = sf_path_join(ctx, folder, name);
    *there = path && sf_is_folder(path);
    sf_free(ctx, path);
    return path ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_frame_images(sf_context *ctx, const char *folder, const char *wanted, const char **images) {
    static const char *const smaller[] = {"images_2", "images_4", "images_8"};
    int there = 1;
    *images = wanted;
    sf_status status = wanted ? SF_OK : holds_folder(ctx, folder, "images", &there);
    if (status || there) return status;
    for (size_t i = 0; !there && i < sizeof smaller / sizeof *smaller; i++) {
        status = holds_folder(ctx, folder, smaller[i], &there);
        if (status) return status;
        if (there) *images = smaller[i];
    }
    if (there)
        sf_log(ctx, SF_LOG_INFO, "%s: there is no images/: the pictures of %s/ are taken", folder, *images);
    return SF_OK;
}

/* Blender leaves the ending out. */
static sf_status complete(sf_context *ctx, sf_entry *e) {
    static const char *const endings[] = {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", NULL};
    return sf_entry_complete(ctx, e, endings);
}

/* Pictures of another size stand in images_4/ under the same names. */
static sf_status replace_folder(sf_context *ctx, const char *folder, const char *images, sf_entry *e) {
    char *other = sf_path_join(ctx, folder, images);
    char *path = other ? sf_path_join(ctx, other, e->name + sizeof usual - 1) : NULL;
    sf_free(ctx, other);
    if (!path) return SF_ERR_MEMORY;
    sf_free(ctx, e->path);
    e->path = path;
    return complete(ctx, e);
}

sf_status sf_frame_find_picture(sf_context *ctx, const char *folder, const char *images, sf_entry *e,
                                int *named) {
    *named = !strncmp(e->name, usual, sizeof usual - 1);
    sf_status status = complete(ctx, e);
    if (!status && !e->width && sf_picture_size(ctx, e->path, &e->width, &e->height) == SF_ERR_MEMORY)
        status = SF_ERR_MEMORY;
    return status || !images || !*named ? status : replace_folder(ctx, folder, images, e);
}
