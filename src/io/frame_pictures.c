/* frame_pictures.c - see frame_pictures.h. */
#include "frame_pictures.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "around.h"
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

static size_t stem_of(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot && dot > name ? (size_t)(dot - name) : strlen(name);
}

/* The only picture of the folder whose name differs in ending and case alone, in `near`; 0: none, or several.
 */
static int find_near(const char *path, const char *name, char near[NAME_MAX + 1]) {
    DIR *folder = opendir(path);
    const struct dirent *e;
    size_t stem = stem_of(name);
    int count = 0;
    while (folder && (e = readdir(folder))) {
        if (stem_of(e->d_name) != stem || strncasecmp(e->d_name, name, stem)) continue;
        if (!sf_is_picture_name(e->d_name) || !sf_holds_file(path, e->d_name)) continue;
        snprintf(near, NAME_MAX + 1, "%s", e->d_name);
        count++;
    }
    if (folder) closedir(folder);
    return count == 1;
}

/* Takes a picture whose name on disk has another ending or another case, where that is the only one. */
static sf_status take_near(sf_context *ctx, sf_entry *e) {
    char near[NAME_MAX + 1];
    const char *slash = strrchr(e->path, '/');
    char *folder = sf_path_folder(ctx, e->path);
    sf_status status = folder ? SF_OK : SF_ERR_MEMORY;
    if (folder && find_near(folder, slash ? slash + 1 : e->path, near)) {
        char *path = sf_path_join(ctx, folder, near);
        if (path) {
            sf_free(ctx, e->path);
            e->path = path;
            e->near_name = 1;
        } else {
            status = SF_ERR_MEMORY;
        }
    }
    sf_free(ctx, folder);
    return status;
}

/* Blender leaves the ending out. */
static sf_status complete(sf_context *ctx, sf_entry *e) {
    static const char *const endings[] = {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", NULL};
    sf_status status = sf_entry_complete(ctx, e, endings);
    return status || sf_is_file(e->path) ? status : take_near(ctx, e);
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

void sf_frame_tell_near(const sf_project *project, const char *file) {
    const sf_entry *first = NULL;
    size_t count = 0;
    for (size_t i = 0; i < project->count; i++) {
        if (!project->entries[i].near_name) continue;
        if (!count++) first = &project->entries[i];
    }
    if (first)
        sf_log(project->ctx, SF_LOG_WARNING,
               "%s: %zu pictures have another ending or another case on disk (first: file_path %s is %s)",
               file, count, first->name, first->path);
}
