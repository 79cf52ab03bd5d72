/* paths.c - paths of files and folders. */
#include "paths.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

char *sf_text_copy(sf_context *ctx, const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = sf_alloc(ctx, size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

char *sf_path_join(sf_context *ctx, const char *folder, const char *name) {
    int stem = (int)strlen(folder);
    while (stem && folder[stem - 1] == '/') stem--;
    size_t size = (size_t)stem + strlen(name) + 2;
    char *path = sf_alloc(ctx, size, 1);
    if (path) snprintf(path, size, "%.*s/%s", stem, folder, name);
    return path;
}

char *sf_path_folder(sf_context *ctx, const char *path) {
    const char *slash = strrchr(path, '/');
    if (!slash) return sf_text_copy(ctx, ".");
    size_t size = (size_t)(slash - path) + 1;
    char *folder = sf_alloc(ctx, size + 1, 1);
    if (folder) snprintf(folder, size + 1, "%s", path);
    return folder;
}

int sf_is_folder(const char *path) {
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

sf_status sf_check_link(sf_context *ctx, const char *folder) {
    char target[PATH_MAX];
    struct stat st;
    ssize_t length = stat(folder, &st) ? readlink(folder, target, sizeof target - 1) : -1;
    if (length < 0) return SF_OK;
    target[length] = 0;
    return sf_fail(ctx, SF_ERR_IO,
                   "%s: is a link to %s, which is not there: put that folder back, link to where it is now "
                   "(ln -sfn FOLDER %s), or remove the link",
                   folder, target, folder);
}

int sf_is_file(const char *path) {
    struct stat st;
    return !stat(path, &st) && S_ISREG(st.st_mode);
}

static int holds(const char *folder, const char *name, int (*is_such)(const char *path)) {
    char path[PATH_MAX]; /* a longer one cannot be opened */
    int size = snprintf(path, sizeof path, "%s/%s", folder, name);
    return size > 0 && (size_t)size < sizeof path && is_such(path);
}

int sf_holds_file(const char *folder, const char *name) { return holds(folder, name, sf_is_file); }

int sf_holds_folder(const char *folder, const char *name) { return holds(folder, name, sf_is_folder); }

int sf_name_stays_inside(const char *name) {
    if (*name == '/') return 0;
    int depth = 0;
    while (*name) {
        size_t length = strcspn(name, "/");
        if (length == 2 && !strncmp(name, "..", 2)) {
            if (--depth < 0) return 0;
        } else if (length > 1 || (length == 1 && *name != '.')) {
            depth++;
        }
        name += length + (name[length] == '/');
    }
    return depth > 0;
}

static int is_digit(char c) { return c >= '0' && c <= '9'; }

/* Two runs of digits by their values; both pointers are moved behind them. */
static int compare_runs(const char **a, const char **b) {
    while (**a == '0') ++*a;
    while (**b == '0') ++*b;
    size_t n = strspn(*a, "0123456789"), m = strspn(*b, "0123456789");
    int order = n != m ? (n < m ? -1 : 1) : memcmp(*a, *b, n);
    *a += n;
    *b += m;
    return order;
}

int sf_natural_order(const char *a, const char *b) {
    const char *x = a, *y = b;
    while (*x && *y) {
        int order = 0;
        if (is_digit(*x) && is_digit(*y))
            order = compare_runs(&x, &y);
        else
            order = (unsigned char)*x++ - (unsigned char)*y++;
        if (order) return order;
    }
    if (*x || *y) return *x ? 1 : -1;
    return strcmp(a, b); /* 01 and 1 */
}
