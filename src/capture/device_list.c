/* device_list.c - the list of cameras. */
#include "device_list.h"

#include <string.h>

typedef struct camera {
    sf_device_info info;
    sf_device_mode *modes;
} camera;

struct sf_devices {
    sf_context *ctx;
    camera *cameras;
    size_t count, capacity;
};

sf_status sf_devices_create(sf_context *ctx, sf_devices **devices) {
    *devices = sf_calloc(ctx, 1, sizeof **devices);
    if (!*devices) return SF_ERR_MEMORY;
    (*devices)->ctx = ctx;
    return SF_OK;
}

sf_status sf_devices_add(sf_devices *devices, const sf_device_info *info, const sf_device_mode *modes,
                         size_t count) {
    sf_context *ctx = devices->ctx;
    sf_status status = sf_grow(ctx, &devices->cameras, &devices->capacity, devices->count, devices->count + 1,
                               sizeof *devices->cameras);
    if (status != SF_OK) return status;
    camera *c = &devices->cameras[devices->count];
    *c = (camera){*info, NULL};
    c->info.modes = count;
    if (count) {
        c->modes = sf_alloc(ctx, count, sizeof *modes);
        if (!c->modes) return SF_ERR_MEMORY;
        memcpy(c->modes, modes, count * sizeof *modes);
    }
    devices->count++;
    return SF_OK;
}

void sf_devices_free(sf_devices **devices) {
    sf_devices *d = *devices;
    if (!d) return;
    for (size_t i = 0; i < d->count; i++) sf_free(d->ctx, d->cameras[i].modes);
    sf_free(d->ctx, d->cameras);
    sf_free(d->ctx, d);
    *devices = NULL;
}

sf_status sf_devices_get(const sf_devices *devices, size_t index, sf_device_info *info) {
    if (index >= devices->count) return SF_ERR_END;
    *info = devices->cameras[index].info;
    return SF_OK;
}

sf_status sf_devices_get_mode(const sf_devices *devices, size_t index, size_t mode, sf_device_mode *result) {
    if (index >= devices->count || mode >= devices->cameras[index].info.modes) return SF_ERR_END;
    *result = devices->cameras[index].modes[mode];
    return SF_OK;
}
