/* record_folder.c - see record_folder.h. */
#include "record_folder.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* As write_best names it. */
static int is_our_picture(const char *name) {
    return !strncmp(name, "frame_", 6) && strspn(name + 6, "0123456789") >= 6;
}

/* What lies in the folder of an output. */
typedef struct contents {
    int list, unfinished, cameras; /* frames.json, that of a recording which was killed, transforms.json */
    size_t ours, others;           /* pictures that are named like a recording's, and what else is there */
} contents;

static int holds(const char *folder, const char *name) {
    char path[4096];
    struct stat st;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return !stat(path, &st);
}

/* Counts what is in the folder of pictures, or removes those of a recording. 0, or errno. */
static int go_through(const char *folder, contents *c, int clear) {
    DIR *dir = opendir(folder);
    int error = 0;
    if (!dir) return errno;
    for (struct dirent *e; (e = readdir(dir)) && !error;) {
        if (e->d_name[0] == '.') continue;
        int ours = is_our_picture(e->d_name);
        ++*(ours ? &c->ours : &c->others);
        if (clear && ours && unlinkat(dirfd(dir), e->d_name, 0)) error = errno;
    }
    closedir(dir);
    return error;
}

static int look_into(const char *folder, const char *images, contents *c) {
    *c = (contents){.list = holds(folder, "frames.json"),
                    .unfinished = holds(folder, ".frames.json.tmp"),
                    .cameras = holds(folder, "transforms.json")};
    return go_through(images, c, 0);
}

static int clear_recording(const char *folder, const char *images, contents *c) {
    static const char *const lists[] = {"frames.json", "transforms.json"};
    int error = go_through(images, c, 1);
    for (int i = 0; i < 2 && !error; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%s", folder, lists[i]);
        if (unlink(path) && errno != ENOENT) error = errno;
    }
    return error;
}

/* Whether the frames come out of this folder. */
static int is_source(const char *source, const char *folder) {
    static const char scheme[] = "folder:";
    char path[4096];
    struct stat from_folder, to_folder;
    if (strncmp(source, scheme, strlen(scheme)) != 0) return 0;
    const char *from = source + strlen(scheme);
    snprintf(path, sizeof path, "%.*s", (int)strcspn(from, "?"), from);
    return !stat(path, &from_folder) && !stat(folder, &to_folder) && from_folder.st_dev == to_folder.st_dev &&
           from_folder.st_ino == to_folder.st_ino;
}

/* Nothing is removed before all of it is known to be a recording's. */
int record_clear_folder(const args *a, const char *folder, const char *images, const char *source,
                        int force) {
    contents c;
    int error = app_make_folder(a, folder);
    if (!error) error = app_make_folder(a, images);
    if (error) return error;
    error = look_into(folder, images, &c);
    if (error) return app_say(a, images, strerror(error));
    if (!c.list && !c.cameras && !c.ours && !c.others) return 0;
    if (!force)
        return app_say(a, c.list || c.cameras ? folder : images,
                       "holds a recording, or other pictures: --force writes over a recording");
    if (c.others || (!c.list && !c.unfinished))
        return app_say(a, images, "holds pictures that are no recording's");
    if (is_source(source, folder) || is_source(source, images))
        return app_say(a, folder, "is where the frames come from: --force would remove them");
    error = clear_recording(folder, images, &c);
    return error ? app_say(a, folder, strerror(error)) : 0;
}
