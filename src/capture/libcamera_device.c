/* libcamera_device.c - see libcamera_device.h. */
#include "libcamera_device.h"

#include <dirent.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sysmacros.h>
#include <unistd.h>

sf_status sf_libcamera_fail(const sf_libcamera_device *device, sf_status status, int error,
                            const char *format, ...) {
    char what[sizeof device->ctx->error];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    return error
               ? sf_fail(device->ctx, status, "libcamera: %s: %s: %s", device->id, what, strerror(abs(error)))
               : sf_fail(device->ctx, status, "libcamera: %s: %s", device->id, what);
}

sf_status sf_libcamera_add_node(sf_libcamera_device *device, dev_t node) {
    sf_status status = sf_grow(device->ctx, &device->nodes, &device->capacity, device->count,
                               device->count + 1, sizeof *device->nodes);
    if (status == SF_OK) device->nodes[device->count++] = node;
    return status;
}

/* The numbers of a device of sysfs. 0: it has none. */
static int read_node(const char *folder, const char *name, dev_t *node) {
    char path[512];
    unsigned a, b;
    snprintf(path, sizeof path, "%s/%s/dev", folder, name);
    FILE *file = fopen(path, "re");
    int read = file ? fscanf(file, "%u:%u", &a, &b) : 0;
    if (file) fclose(file);
    if (read == 2) *node = makedev(a, b);
    return read == 2;
}

sf_status sf_libcamera_find_nodes(sf_libcamera_device *device, const char *folder,
                                  int (*is_its)(void *user, dev_t node), void *user) {
    DIR *nodes = opendir(folder);
    const struct dirent *entry;
    sf_status status = SF_OK;
    while (nodes && status == SF_OK && (entry = readdir(nodes))) {
        dev_t node;
        if (read_node(folder, entry->d_name, &node) && is_its(user, node))
            status = sf_libcamera_add_node(device, node);
    }
    if (nodes) closedir(nodes);
    return status;
}

int sf_libcamera_present(const sf_libcamera_device *device) {
    for (size_t i = 0; i < device->count; i++) {
        char path[64];
        snprintf(path, sizeof path, "/sys/dev/char/%u:%u", major(device->nodes[i]), minor(device->nodes[i]));
        if (access(path, F_OK) != 0) return 0;
    }
    return 1;
}

void sf_libcamera_forget(sf_libcamera_device *device) {
    sf_free(device->ctx, device->nodes);
    device->nodes = NULL;
    device->count = device->capacity = 0;
}
