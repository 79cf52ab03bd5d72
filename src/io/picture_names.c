/* picture_names.c - see picture_names.h. */
#include "picture_names.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "paths.h"

static const char *const unread[] = {".heic", ".heif", ".webp", ".tif", ".tiff", ".bmp",
                                     ".avif", ".jxl",  ".jp2",  ".gif", ".dng",  ".cr2",
                                     ".cr3",  ".nef",  ".arw",  ".orf", ".rw2",  ".raf"};
enum { UNREAD = sizeof unread / sizeof *unread };

int sf_is_picture_name(const char *name) {
    static const char *const endings[] = {".jpg", ".jpeg", ".png"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && dot > name && i < sizeof endings / sizeof *endings; i++)
        if (!strcasecmp(dot, endings[i])) return 1;
    return 0;
}

size_t sf_count_unread_pictures(const char *path, char ending[SF_ENDING]) {
    size_t counts[UNREAD] = {0}, most = 0;
    const struct dirent *e;
    DIR *folder = opendir(path);
    while (folder && (e = readdir(folder))) {
        const char *dot = strrchr(e->d_name, '.');
        for (size_t i = 0; dot && dot > e->d_name && i < UNREAD; i++)
            counts[i] += !strcasecmp(dot, unread[i]) && sf_holds_file(path, e->d_name);
    }
    if (folder) closedir(folder);
    for (size_t i = 1; i < UNREAD; i++)
        if (counts[i] > counts[most]) most = i;
    snprintf(ending, SF_ENDING, "%s", unread[most]);
    return counts[most];
}
