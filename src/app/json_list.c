/* json_list.c - a JSON file whose long array is written as it grows. */
#include "json_list.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void keep_error(json_list *list) {
    if (!list->error) list->error = errno ? errno : EIO;
}

static char *join(const char *folder, const char *before, const char *name, const char *after) {
    size_t size = strlen(folder) + strlen(before) + strlen(name) + strlen(after) + 2;
    char *path = malloc(size);
    if (path) snprintf(path, size, "%s/%s%s%s", folder, before, name, after);
    return path;
}

static void put(json_list *list, const char *text) {
    errno = 0;
    if (!list->error && fputs(text, list->file) == EOF) keep_error(list);
}

/* An object without its braces; "" for none. */
static void put_object(json_list *list, json_t *object) {
    char *text = object ? json_dumps(object, JSON_REAL_PRECISION(15)) : NULL;
    size_t length = text ? strlen(text) : 0;
    if (object && length < 2) list->error = ENOMEM;
    if (length > 2) {
        text[length - 1] = 0;
        put(list, text + 1);
    }
    free(text);
    json_decref(object);
}

static void open_file(json_list *list) {
    int fd = open(list->temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    list->file = fd < 0 ? NULL : fdopen(fd, "w");
    if (list->file) return;
    keep_error(list);
    if (fd >= 0) close(fd);
}

/* The disk's room for the entries to come and for the end is taken in advance, so that a full disk is noticed
 * while the list can still be ended. */
static void reserve(json_list *list) {
    enum { ROOM = 1 << 16 };
    if (list->error) return;
    long at = ftell(list->file);
    if (at < 0 || (uint64_t)at + ROOM <= list->reserved) return;
    int error = posix_fallocate(fileno(list->file), (off_t)list->reserved, 2 * ROOM);
    if (!error) list->reserved += 2 * ROOM;
    if (error && !list->full) list->full = error;
}

static void give_back(json_list *list) {
    long at = ftell(list->file);
    if (at < 0 || ftruncate(fileno(list->file), at)) keep_error(list);
}

void json_list_open(json_list *list, const char *folder, const char *name, json_t *head, const char *key) {
    *list = (json_list){.path = join(folder, "", name, ""), .temporary = join(folder, ".", name, ".tmp")};
    errno = ENOMEM;
    if (!list->path || !list->temporary || !head)
        keep_error(list);
    else
        open_file(list);
    reserve(list);
    put(list, "{\n ");
    put_object(list, head);
    put(list, ",\n \"");
    put(list, key);
    put(list, "\": [");
}

void json_list_add(json_list *list, json_t *entry) {
    reserve(list);
    put(list, list->entries++ ? ",\n  {" : "\n  {");
    put_object(list, entry);
    put(list, "}");
}

/* What is written reaches the disk, before it has its name. */
static void sync_file(json_list *list) {
    errno = 0;
    if (fflush(list->file)) keep_error(list);
    give_back(list);
    if (fsync(fileno(list->file))) keep_error(list);
    if (fclose(list->file)) keep_error(list);
}

int json_list_close(json_list *list, json_t *tail) {
    put(list, "\n ]");
    if (tail) put(list, ",\n ");
    put_object(list, tail);
    put(list, "\n}\n");
    if (list->file) sync_file(list);
    if (!list->error && rename(list->temporary, list->path)) keep_error(list);
    if (list->error && list->temporary) unlink(list->temporary);
    free(list->path);
    free(list->temporary);
    return list->error;
}
