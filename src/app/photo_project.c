/* photo_project.c - see photo_project.h. */
#define _XOPEN_SOURCE 700 /* realpath */
#include "photo_project.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* What PROJECT/NAME is for a link to a folder. */
typedef enum link_state { LINK_FAILED, LINK_WANTED, LINK_THERE } link_state;

static link_state look_at_link(const args *a, const char *project, const char *folder, const char *name,
                               char target[PATH_MAX]) {
    char path[PATH_MAX], there[PATH_MAX];
    if (!realpath(folder, target)) {
        app_say(a, folder, strerror(errno));
        return LINK_FAILED;
    }
    snprintf(path, sizeof path, "%s/%s", project, name);
    if (!realpath(path, there)) return LINK_WANTED;
    if (!strcmp(target, there)) return LINK_THERE;
    app_say(a, path, "is there, and is another folder: remove it, or name another project");
    return LINK_FAILED;
}

int project_check_link(const args *a, const char *project, const char *folder, const char *name) {
    char target[PATH_MAX];
    return look_at_link(a, project, folder, name, target) == LINK_FAILED ? EXIT_FAILED : 0;
}

/* The part of a path behind a folder that it lies in; NULL: it lies elsewhere. */
static const char *within(const char *path, const char *folder) {
    size_t length = strlen(folder);
    if (strncmp(path, folder, length) || path[length] != '/') return NULL;
    return path + length + 1;
}

/* What the link says; both paths are real ones. A link over a longer way would break when the project alone
 * is moved, and gain nothing. */
static void write_target(const char *target, const char *project, char text[PATH_MAX]) {
    char above[PATH_MAX];
    const char *rest;
    snprintf(above, sizeof above, "%s", project);
    *strrchr(above, '/') = 0;
    if ((rest = within(target, project))) {
        snprintf(text, PATH_MAX, "%s", rest);
    } else if ((rest = within(project, target))) {
        size_t n = (size_t)snprintf(text, PATH_MAX, "..");
        while ((rest = strchr(rest, '/')) && n + 4 < PATH_MAX)
            n += (size_t)snprintf(text + n, PATH_MAX - n, "/.."), rest++;
    } else {
        rest = within(target, above);
        if (!rest || snprintf(text, PATH_MAX, "../%s", rest) >= PATH_MAX)
            snprintf(text, PATH_MAX, "%s", target);
    }
}

int project_link(const args *a, const char *project, const char *folder, const char *name) {
    char target[PATH_MAX], real[PATH_MAX], path[PATH_MAX], text[PATH_MAX];
    link_state state = look_at_link(a, project, folder, name, target);
    if (state != LINK_WANTED) return state == LINK_FAILED ? EXIT_FAILED : 0;
    if (!realpath(project, real)) return app_say(a, project, strerror(errno));
    write_target(target, real, text);
    snprintf(path, sizeof path, "%s/%s", project, name);
    unlink(path); /* a link to nothing */
    return symlink(text, path) ? app_say(a, path, strerror(errno)) : 0;
}

/* Whether the project lies in the photos' way: its folder images is then their own, not a link. */
static int holds(const char *project, const char *photos) {
    char of_photos[PATH_MAX], of_project[PATH_MAX];
    if (!realpath(photos, of_photos) || !realpath(project, of_project)) return 1;
    return within(of_photos, of_project) != NULL;
}

void project_drop_masks(const char *project, const char *photos) {
    char path[PATH_MAX];
    struct stat st;
    snprintf(path, sizeof path, "%s/masks", project);
    if (lstat(path, &st) || !S_ISLNK(st.st_mode)) return;
    if (!holds(project, photos)) unlink(path);
}

/* Whether PROJECT/NAME is a link, and not to `target`, which may be NULL: to nothing. */
static int leads_elsewhere(const char *project, const char *name, const char *target) {
    char path[PATH_MAX], there[PATH_MAX], wanted[PATH_MAX];
    struct stat st;
    snprintf(path, sizeof path, "%s/%s", project, name);
    if (lstat(path, &st) || !S_ISLNK(st.st_mode)) return 0;
    if (!realpath(path, there)) return 1;
    return target && realpath(target, wanted) && strcmp(there, wanted) != 0;
}

static void remove_link(const char *project, const char *name) {
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/%s", project, name);
    unlink(path);
}

int project_renew_links(const args *a, sf_context *ctx, const char *project, const char *photos) {
    char masks[PATH_MAX], path[PATH_MAX];
    struct stat st;
    int error = 0;
    if (leads_elsewhere(project, "images", photos)) {
        remove_link(project, "images");
        error = project_link(a, project, photos, "images");
    }
    if (leads_elsewhere(project, "masks", NULL)) remove_link(project, "masks");
    snprintf(path, sizeof path, "%s/masks", project);
    if (error || args_value(a, "no-masks") || args_value(a, "masks") || !lstat(path, &st)) return error;
    if (sf_sfm_find_masks(ctx, photos, masks, sizeof masks)) return app_fail(a, ctx);
    return *masks ? project_link(a, project, masks, "masks") : 0;
}

int project_compare(const args *a, sf_context *ctx, const char *project, const char *photos,
                    sf_photos_change *change) {
    char note[PATH_MAX], cameras[PATH_MAX];
    snprintf(note, sizeof note, "%s/photos.txt", project);
    snprintf(cameras, sizeof cameras, "%s/sparse/0", project);
    return sf_sfm_compare_photos(ctx, photos, cameras, note, change) ? app_fail(a, ctx) : 0;
}

int project_tell_change(const args *a, sf_context *ctx, const char *project) {
    char images[PATH_MAX];
    sf_photos_change c;
    if (snprintf(images, sizeof images, "%s/images", project) >= PATH_MAX) return 0;
    if (access(images, R_OK)) return 0; /* loading the project says so */
    int error = project_compare(a, ctx, project, images, &c);
    if (error || !c.noted || c.other_cameras || !(c.added || c.removed || c.replaced)) return error;
    fprintf(stderr,
            "warning: %s: photos were changed after their cameras were found (%zu added, %zu removed, %zu "
            "replaced), and what was added has no camera: splatfit cameras %s -o %s finds them again\n",
            project, c.added, c.removed, c.replaced, project, project);
    return 0;
}

int project_note(const args *a, sf_context *ctx, const char *project, const char *photos) {
    char note[PATH_MAX], cameras[PATH_MAX];
    snprintf(note, sizeof note, "%s/photos.txt", project);
    snprintf(cameras, sizeof cameras, "%s/sparse/0", project);
    return sf_sfm_note_photos(ctx, photos, cameras, note) ? app_fail(a, ctx) : 0;
}

int project_check_cameras(const args *a, sf_context *ctx, const char *project) {
    static const char *const files[] = {"cameras.bin", "images.bin", "points3D.bin",
                                        "cameras.txt", "images.txt", "points3D.txt"};
    char path[PATH_MAX];
    sf_photos_change change;
    size_t there = 0;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        snprintf(path, sizeof path, "%s/sparse/0/%s", project, files[i]);
        there += !access(path, F_OK);
    }
    if (!there) return 0;
    int error = project_compare(a, ctx, project, NULL, &change);
    if (error || (there <= 3 && change.noted && !change.other_cameras)) return error;
    snprintf(path, sizeof path, "%s/sparse/0", project);
    return app_say(a, path,
                   "holds cameras that splatfit did not find, or that were changed since: name another "
                   "project, or rename that folder");
}

int project_keep(const args *a, const char *project, const char *name) {
    char path[PATH_MAX], kept[PATH_MAX];
    struct stat st;
    snprintf(path, sizeof path, "%s/%s", project, name);
    if (lstat(path, &st)) return 0;
    snprintf(kept, sizeof kept, "%s/%s.old", project, name);
    for (int n = 2; !lstat(kept, &st); n++) snprintf(kept, sizeof kept, "%s/%s.old%d", project, name, n);
    if (rename(path, kept)) return app_say(a, path, strerror(errno));
    if (!args_value(a, "quiet")) fprintf(stderr, "%s: what was there before is kept as %s\n", path, kept);
    return 0;
}
