/* frame_pictures.c - see frame_pictures.h. */
#include "frame_pictures.h"

#include <string.h>

#include "around.h"
#include "near_names.h"
#include "paths.h"
#include "picture_names.h"

static const char usual[] = "images/";

void sf_frame_images(sf_context *ctx, const char *folder, const char *wanted, const char **images) {
    *images = wanted;
    for (int i = 0; !wanted && i < SF_IMAGE_FOLDERS; i++) {
        if (!sf_holds_folder(folder, sf_image_folders[i])) continue;
        if (!i) return;
        *images = sf_image_folders[i];
        sf_tell_images(ctx, folder, *images);
        return;
    }
}

/* Blender leaves the ending out. */
static sf_status complete(sf_context *ctx, sf_entry *e) {
    static const char *const endings[] = {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", NULL};
    sf_status status = sf_entry_complete(ctx, e, endings);
    return status || sf_is_file(e->path) ? status : sf_entry_take_near(ctx, e);
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
