/* photo_folder.c - see photo_folder.h. */
#include "photo_folder.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <strings.h>

#include "../io/dataset.h"
#include "../io/paths.h"
#include "../io/picture_names.h"

enum { DEEPEST = 4 };

typedef struct walk {
    const char *root;
    sf_photo_visit visit;
    void *user;
    int found, deepest;
} walk;

static int join(char path[PATH_MAX], const char *folder, const char *name) {
    int size =
        *folder ? snprintf(path, PATH_MAX, "%s/%s", folder, name) : snprintf(path, PATH_MAX, "%s", name);
    return size > 0 && size < PATH_MAX;
}

static int is_for_photos(const char *path, const char *name) {
    return *name != '.' && strcasecmp(name, "masks") != 0 && sf_is_folder(path) && !sf_holds_project(path);
}

/* `within`: the folder's name below the root, "" the root itself. */
static int visit_folder(walk *w, const char *within, int depth) {
    char path[PATH_MAX], name[PATH_MAX], inner[PATH_MAX];
    const struct dirent *e;
    int ended = 0;
    if (!join(path, w->root, within)) return 0;
    DIR *folder = opendir(path);
    if (!folder) return depth ? 0 : -1;
    while (!ended && (e = readdir(folder))) {
        if (!join(name, within, e->d_name)) continue;
        if (sf_is_picture_name(e->d_name) && sf_holds_file(path, e->d_name))
            w->found = 1, ended = w->visit(w->user, name);
        else if (depth < w->deepest && join(inner, path, e->d_name) && is_for_photos(inner, e->d_name))
            ended = visit_folder(w, name, depth + 1);
    }
    closedir(folder);
    return ended;
}

int sf_photo_folder_walk(const char *folder, sf_photo_visit visit, void *user) {
    walk w = {.root = folder, .visit = visit, .user = user};
    int ended = visit_folder(&w, "", 0);
    if (ended || w.found) return ended;
    w.deepest = DEEPEST;
    return visit_folder(&w, "", 0);
}
