/* files.c - names of files: whether they can be written, the folders above them, JSON. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app.h"

int app_names_model(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot && (!strcasecmp(dot, ".ply") || !strcasecmp(dot, ".spz") || !strcasecmp(dot, ".splat") ||
                   !strcasecmp(dot, ".glb") || !strcasecmp(dot, ".gltf") || !strcasecmp(dot, ".sog"));
}

char *app_folder(const char *path) {
    const char *slash = strrchr(path, '/');
    size_t n = slash ? (size_t)(slash - path) + 1 : 0;
    char *folder = malloc(n + 1);
    if (!folder) return NULL;
    memcpy(folder, path, n);
    folder[n] = 0;
    return folder;
}

char *app_cameras_beside(const char *path) {
    static const char end[] = ".cameras.json", packed[] = ".compressed";
    size_t n = strlen(path), more = sizeof packed - 1;
    if (app_names_model(path)) n = (size_t)(strrchr(path, '.') - path);
    if (n > more && !strncasecmp(path + n - more, packed, more))
        n -= more; /* NAME.compressed.ply is NAME too */
    char *cameras = malloc(n + sizeof end);
    if (!cameras) return NULL;
    memcpy(cameras, path, n);
    memcpy(cameras + n, end, sizeof end);
    return cameras;
}

char *app_find_cameras_beside(const char *path) {
    static const char common[] = "cameras.json";
    char *found = app_cameras_beside(path);
    if (found && !access(found, R_OK)) return found;
    free(found);
    char *folder = app_folder(path);
    found = folder ? malloc(strlen(folder) + sizeof common) : NULL;
    if (found) strcat(strcpy(found, folder), common);
    free(folder);
    if (found && !access(found, R_OK)) return found;
    free(found);
    return NULL;
}

int app_make_folders(const args *a, const char *path) {
    char *part = malloc(strlen(path) + 1);
    if (!part) return app_say(a, path, "out of memory");
    strcpy(part, path);
    for (char *c = part + 1; *part && *c; c++) {
        if (*c != '/') continue;
        *c = 0;
        if (mkdir(part, 0777) && errno != EEXIST) {
            app_say(a, part, strerror(errno));
            free(part);
            return EXIT_FAILED;
        }
        *c = '/';
    }
    free(part);
    return 0;
}

int app_make_folder(const args *a, const char *path) {
    struct stat st;
    if (!*path) return app_say(a, "\"\"", "is not the name of a folder");
    int error = app_make_folders(a, path);
    if (error) return error;
    if (mkdir(path, 0777) && errno != EEXIST) return app_say(a, path, strerror(errno));
    if (!stat(path, &st) && !S_ISDIR(st.st_mode)) return app_say(a, path, strerror(ENOTDIR));
    return access(path, W_OK | X_OK) ? app_say(a, path, strerror(errno)) : 0;
}

int app_check_output(const args *a, const char *path) {
    struct stat st;
    if (!*path) return app_say(a, "\"\"", "is not the name of a file");
    if (!strcmp(path, "-")) return 0;
    if (!stat(path, &st)) {
        if (S_ISDIR(st.st_mode)) return app_say(a, path, "is a folder");
        if (!S_ISREG(st.st_mode)) return access(path, W_OK) ? app_say(a, path, strerror(errno)) : 0;
    } else if (errno != ENOENT) {
        return app_say(a, path, strerror(errno)); /* its parent is a file, for example */
    } else if (!lstat(path, &st)) {
        return app_say(a, path, "is a symbolic link to nothing");
    }
    char *folder = app_folder(path);
    if (!folder) return app_say(a, path, "out of memory");
    int error = access(*folder ? folder : ".", W_OK | X_OK) ? errno : 0;
    if (error) app_say(a, path, strerror(error));
    free(folder);
    return error ? EXIT_FAILED : 0;
}

const char *app_output(const args *a, const char *name) {
    const char *path = args_value(a, name);
    return path && strcmp(path, "none") ? path : NULL;
}

int app_check_model(const args *a, sf_context *ctx, const char *path) {
    int error = app_check_output(a, path);
    if (error || !sf_model_check_name(ctx, path)) return error;
    app_fail(a, ctx);
    return EXIT_USAGE;
}

int app_check_outputs(const args *a, sf_context *ctx, const char *output, const char *const *names, int n) {
    for (int i = -1; i < n; i++) {
        const char *path = i < 0 ? output : app_output(a, names[i]);
        int error = !path ? 0 : i < 0 ? app_check_model(a, ctx, path) : app_check_output(a, path);
        if (error) return error;
        for (int k = -1; k < i && path; k++) {
            const char *other = k < 0 ? output : app_output(a, names[k]);
            if (!other || strcmp(path, other) || !strcmp(path, "/dev/null")) continue;
            app_say(a, path, "is named for two outputs");
            return EXIT_USAGE;
        }
    }
    return 0;
}

int app_write_json(const args *a, sf_context *ctx, const char *path, json_t *json) {
    char *text = json ? json_dumps(json, JSON_INDENT(1)) : NULL;
    json_decref(json);
    if (!text) return app_say(a, path, "out of memory");
    size_t n = strlen(text);
    text[n] = '\n'; /* in place of the 0 */
    sf_status status = sf_write_file(ctx, path, text, n + 1);
    free(text);
    return status ? app_fail(a, ctx) : 0;
}
