/* no_project.c - see no_project.h. */
#include "no_project.h"

#include "../base/context.h"
#include "../base/file.h"
#include "around.h"
#include "dataset.h"
#include "paths.h"
#include "picture_names.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

static const char *const videos[] = {".mp4",  ".mov", ".m4v", ".mkv",  ".webm", ".avi", ".mts",
                                     ".m2ts", ".3gp", ".mpg", ".mpeg", ".wmv",  ".y4m", NULL};

int sf_is_video_name(const char *name) {
    const char *dot = strrchr(name, '.');
    for (const char *const *ending = videos; dot && *ending; ending++)
        if (!strcasecmp(dot, *ending)) return 1;
    return 0;
}

/* How many files of the folder are wanted; the name of one of them in `name`. */
static size_t count_files(const char *path, int (*is_wanted)(const char *name), char name[PATH_MAX]) {
    DIR *folder = opendir(path);
    const struct dirent *e;
    size_t count = 0;
    while (folder && (e = readdir(folder))) {
        if (!is_wanted(e->d_name) || !sf_holds_file(path, e->d_name)) continue;
        snprintf(name, PATH_MAX, "%s", e->d_name);
        count++;
    }
    if (folder) closedir(folder);
    return count;
}

static int is_on_path(const char *program) {
    char file[PATH_MAX];
    const char *path = getenv("PATH");
    while (path && *path) {
        int length = (int)strcspn(path, ":");
        int size = snprintf(file, sizeof file, "%.*s/%s", length, path, program);
        if (size > 0 && (size_t)size < sizeof file && !access(file, X_OK)) return 1;
        path += length + (path[length] == ':');
    }
    return 0;
}

static const char *install(const char *program) {
    if (is_on_path(program)) return "";
    return !strcmp(program, "colmap") ? "apt install colmap && " : "apt install ffmpeg && ";
}

/* A path without the slashes at its end. */
static int stem(const char *path) {
    int length = (int)strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    return length;
}

/* The first `length` bytes of a text and an ending as one word of the shell: within single quotes, of which
 * each in the text is '\''. NULL: no memory. */
static char *quote(sf_context *ctx, const char *text, int length, const char *ending) {
    char *word = sf_alloc(ctx, 4 * (size_t)length + strlen(ending) + 3, 1), *at = word;
    if (!word) return NULL;
    *at++ = '\'';
    for (int i = 0; i < length; i++) {
        if (text[i] == '\'')
            at += sprintf(at, "'\\''");
        else
            *at++ = text[i];
    }
    sprintf(at, "%s'", ending);
    return word;
}

static sf_status tell_images(sf_context *ctx, const char *folder, size_t count) {
    char *P = quote(ctx, folder, stem(folder), "");
    sf_status status = SF_ERR_MEMORY;
    if (P)
        status = sf_fail(
            ctx, SF_ERR_IO,
            "%s: no project: %zu pictures in images, but no cameras. This finds them: P=%s; splatfit cameras "
            "\"$P/images\" -o \"$P\"",
            folder, count, P);
    sf_free(ctx, P);
    return status;
}

/* Pictures in the folder itself: a new folder beside it refers to them. */
static sf_status tell_photos(sf_context *ctx, const char *folder, size_t count) {
    char *P = quote(ctx, folder, stem(folder), ".project"), *photos = quote(ctx, folder, stem(folder), "");
    sf_status status = SF_ERR_MEMORY;
    if (P && photos)
        status = sf_fail(
            ctx, SF_ERR_IO,
            "%s: no project: %zu pictures, but no cameras. This finds them: splatfit cameras %s -o %s",
            folder, count, photos, P);
    sf_free(ctx, P);
    sf_free(ctx, photos);
    return status;
}

/* The pictures are further down; other kinds of pictures, depths for example, may be beside them. */
static sf_status tell_photos_in(sf_context *ctx, const char *folder, const char *name) {
    char *path = sf_path_join(ctx, folder, name), *P = quote(ctx, folder, stem(folder), ".project");
    char *photos = path ? quote(ctx, path, (int)strlen(path), "") : NULL;
    sf_status status = SF_ERR_MEMORY;
    if (P && photos)
        status =
            sf_fail(ctx, SF_ERR_IO,
                    "%s: no project: pictures in '%s', but no cameras. This finds them: splatfit cameras %s "
                    "-o %s",
                    folder, name, photos, P);
    sf_free(ctx, path);
    sf_free(ctx, P);
    sf_free(ctx, photos);
    return status;
}

/* COLMAP's database says what was found in pictures, not where the cameras were: the mapper does. */
static sf_status tell_database(sf_context *ctx, const char *folder) {
    char *P = quote(ctx, folder, stem(folder), "");
    sf_status status = SF_ERR_MEMORY;
    if (P)
        status = sf_fail(
            ctx, SF_ERR_IO,
            "%s: no project: COLMAP's database.db, but neither cameras nor pictures. Put the pictures into "
            "its folder images, then: P=%s; %smkdir -p \"$P/sparse\" && QT_QPA_PLATFORM=offscreen colmap "
            "mapper --database_path \"$P/database.db\" --image_path \"$P/images\" --output_path "
            "\"$P/sparse\" && splatfit fit \"$P\" -o splat.ply",
            folder, P, install("colmap"));
    sf_free(ctx, P);
    return status;
}

/* The folder of a project's pictures in place of the project. */
static sf_status tell_project_above(sf_context *ctx, const char *folder, char *above) {
    sf_status status = above ? SF_OK : SF_ERR_MEMORY;
    if (above && sf_holds_project(above))
        status = sf_fail(ctx, SF_ERR_IO,
                         "%s: no project: its pictures belong to the project in '%s': give that instead",
                         folder, above);
    sf_free(ctx, above);
    return status;
}

static sf_status tell_video(sf_context *ctx, sf_status status, const char *what, const char *video) {
    int length = (int)strlen(video);
    char *film = quote(ctx, video, length, ""), *P = quote(ctx, video, length, ".project");
    if (film && P)
        status = sf_fail(ctx, status,
                         "%s: no project: a video, but no cameras. This finds them: %ssplatfit cameras %s -o "
                         "%s",
                         what, install("ffmpeg"), film, P);
    else
        status = SF_ERR_MEMORY;
    sf_free(ctx, film);
    sf_free(ctx, P);
    return status;
}

static sf_status tell_videos(sf_context *ctx, const char *folder, const char *name) {
    char *video = sf_path_join(ctx, folder, name);
    sf_status status = video ? tell_video(ctx, SF_ERR_IO, folder, video) : SF_ERR_MEMORY;
    sf_free(ctx, video);
    return status;
}

/* What an archive holds lies in a folder that is removed again: cameras are found of the user's own.
 * `inside`: the path in it of what is to be fitted, "" for all. */
static sf_status tell_unpack(sf_context *ctx, const char *zip, const char *what, const char *inside) {
    const char *dot = strrchr(zip, '.'), *slash = strrchr(zip, '/');
    int length = dot && dot > (slash ? slash + 1 : zip) ? (int)(dot - zip) : (int)strlen(zip);
    const char *ending = zip[length] ? "" : ".unpacked";
    char text[PATH_MAX];
    int size = snprintf(text, sizeof text, "%.*s%s%s%s", length, zip, ending, *inside ? "/" : "", inside);
    char *file = quote(ctx, zip, (int)strlen(zip), ""), *to = quote(ctx, zip, length, ending);
    char *fitted = size < PATH_MAX ? quote(ctx, text, size, "") : NULL;
    sf_status status = SF_ERR_MEMORY;
    if (file && to && fitted)
        status = sf_fail(ctx, SF_ERR_IO,
                         "%s: no project: %s, but no cameras. This finds them and fits: unzip %s -d %s && "
                         "splatfit fit %s -o splat.ply",
                         zip, what, file, to, fitted);
    sf_free(ctx, file);
    sf_free(ctx, to);
    sf_free(ctx, fitted);
    return status;
}

static sf_status tell_unpack_pictures(sf_context *ctx, size_t count) {
    char what[64];
    snprintf(what, sizeof what, "%zu pictures", count);
    return tell_unpack(ctx, ctx->archive, what, "");
}

sf_status sf_no_project_of_archive(sf_context *ctx, const char *zip, const char *video) {
    return tell_unpack(ctx, zip, "a video", video);
}

/* MP4 and QuickTime, but for the still pictures that begin alike; Matroska and WebM; AVI; YUV4MPEG2; MPEG's
 * program streams (.vob), and transport streams, each packet of which begins with a G. */
static int begins_as_video(const char *path) {
    enum { PACKET = 188, LEAST = 12 };
    static const char *const stills[] = {"heic", "heix", "heif", "mif1", "msf1", "avif", NULL};
    uint8_t start[2 * PACKET + 1] = {0};
    if (sf_read_start(path, start, sizeof start) < LEAST) return 0;
    for (int i = 0; stills[i]; i++)
        if (!memcmp(start + 8, stills[i], 4)) return 0;
    return !memcmp(start + 4, "ftyp", 4) || !memcmp(start, "\x1a\x45\xdf\xa3", 4) ||
           (!memcmp(start, "RIFF", 4) && !memcmp(start + 8, "AVI ", 4)) || !memcmp(start, "YUV4MPEG2", 9) ||
           !memcmp(start, "\0\0\1\xba", 4) ||
           (start[0] == 'G' && start[PACKET] == 'G' && start[2 * PACKET] == 'G');
}

int sf_is_video(const char *path) {
    return sf_is_file(path) && (sf_is_video_name(path) || begins_as_video(path));
}

int sf_names_video(const char *path) { return sf_is_video_name(path) || sf_is_video(path); }

sf_status sf_no_project_in(sf_context *ctx, const char *folder) {
    char name[PATH_MAX], ending[SF_ENDING];
    char *images = sf_path_join(ctx, folder, "images");
    if (!images) return SF_ERR_MEMORY;
    size_t in_images = count_files(images, sf_is_picture_name, name);
    sf_free(ctx, images);
    if (in_images && ctx->archive) return tell_unpack_pictures(ctx, in_images);
    if (in_images && sf_find_folder(folder, sf_holds_project, name))
        return sf_fail(
            ctx, SF_ERR_IO,
            "%s: no project here, but cameras in '%s': give '%.*s/%s' instead; splatfit cameras finds "
            "new ones",
            folder, name, stem(folder), folder, name);
    if (in_images) return tell_images(ctx, folder, in_images);
    size_t here = count_files(folder, sf_is_picture_name, name);
    if (here && ctx->archive) return tell_unpack_pictures(ctx, here);
    if (here) {
        sf_status status = tell_project_above(ctx, folder, sf_path_join(ctx, folder, ".."));
        return status ? status : tell_photos(ctx, folder, here);
    }
    if (count_files(folder, sf_is_video_name, name)) return tell_videos(ctx, folder, name);
    if (sf_holds_file(folder, "database.db")) return tell_database(ctx, folder);
    size_t unread = sf_count_unread_pictures(folder, ending);
    if (unread)
        return sf_fail(
            ctx, SF_ERR_IO,
            "%s: no project: %zu %s files, which are not read: make .jpg or .png of them (ImageMagick, in "
            "that folder: mogrify -format jpg '*%s')",
            folder, unread, ending, ending);
    if (sf_find_folder(folder, sf_holds_project, name))
        return sf_fail(ctx, SF_ERR_IO, "%s: no project here, but in '%s': give '%.*s/%s' instead", folder,
                       name, stem(folder), folder, name);
    if (sf_find_folder(folder, sf_holds_pictures, name)) return tell_photos_in(ctx, folder, name);
    return sf_fail(
        ctx, SF_ERR_IO,
        "%s: no project: looked for cameras.bin or .txt in sparse/0, sparse and here, for transforms.json, "
        "transforms_train.json, reconstruction.json and keyframes, and for pictures and videos",
        folder);
}

sf_status sf_no_project_file(sf_context *ctx, const char *path) {
    if (sf_is_video(path)) return tell_video(ctx, SF_ERR_FORMAT, path, path);
    if (sf_is_picture_name(path))
        return sf_fail(ctx, SF_ERR_FORMAT,
                       "%s: is one picture; a project is a folder of pictures with their cameras (COLMAP, "
                       "transforms.json), of 20 or more from all sides as a rule",
                       path);
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: is neither a folder nor a .json or .zip file", path);
}
