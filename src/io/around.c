/* around.c - see around.h. */
#include "around.h"

#include <dirent.h>
#include <stdio.h>

#include "paths.h"
#include "picture_names.h"

const char *const sf_image_folders[SF_IMAGE_FOLDERS] = {"images", "images_2", "images_4", "images_8"};

void sf_tell_images(sf_context *ctx, const char *project, const char *name) {
    sf_log(ctx, SF_LOG_INFO, "%s: there is no images/: the pictures of %s/ are taken", project, name);
}

typedef struct search {
    const char *top;
    int (*fits)(const char *folder);
    char *best; /* "": none yet */
} search;

static int join(char path[PATH_MAX], const char *folder, const char *name) {
    int size = snprintf(path, PATH_MAX, "%s%s%s", folder, *folder ? "/" : "", name);
    return size > 0 && size < PATH_MAX;
}

/* `levels` below `inside`, a folder's name within the top. */
static void look(const search *s, const char *inside, int levels) {
    char path[PATH_MAX], name[PATH_MAX];
    const struct dirent *e;
    DIR *folder = join(path, s->top, inside) ? opendir(path) : NULL;
    while (folder && (e = readdir(folder))) {
        if (*e->d_name == '.' || !join(name, inside, e->d_name) || !join(path, s->top, name)) continue;
        if (!sf_is_folder(path)) continue;
        if (levels > 1)
            look(s, name, levels - 1);
        else if (s->fits(path) && (!*s->best || sf_natural_order(name, s->best) < 0))
            snprintf(s->best, PATH_MAX, "%s", name);
    }
    if (folder) closedir(folder);
}

int sf_find_folder(const char *top, int (*fits)(const char *folder), char name[PATH_MAX]) {
    search s = {.top = top, .fits = fits, .best = name};
    *name = 0;
    for (int levels = 1; levels <= 2 && !*name; levels++) look(&s, "", levels);
    return *name != 0;
}

int sf_holds_pictures(const char *path) {
    const struct dirent *e;
    int found = 0;
    DIR *folder = opendir(path);
    while (folder && !found && (e = readdir(folder)))
        found = sf_is_picture_name(e->d_name) && sf_holds_file(path, e->d_name);
    if (folder) closedir(folder);
    return found;
}
