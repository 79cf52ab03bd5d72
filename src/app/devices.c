/* devices.c - splatfit devices: the cameras of this machine, and what they offer. */
#include <stdio.h>
#include <string.h>

#include "app.h"

/* "640x480", "32x32 to 4096x2160 by 2x2" */
static void size_text(const sf_device_mode *m, char text[64]) {
    if (!m->width)
        snprintf(text, 64, "any size");
    else if (!m->width_most)
        snprintf(text, 64, "%dx%d", (int)m->width, (int)m->height);
    else
        snprintf(text, 64, "%dx%d to %dx%d by %dx%d", (int)m->width, (int)m->height, (int)m->width_most,
                 (int)m->height_most, (int)m->width_step, (int)m->height_step);
}

static void rate_text(const sf_device_mode *m, char text[64]) {
    *text = 0;
    if (m->fps_most <= 0) return;
    if (m->fps_least > 0 && m->fps_least < m->fps_most)
        snprintf(text, 64, "%.4g to %.4g fps", m->fps_least, m->fps_most);
    else
        snprintf(text, 64, "%.4g fps", m->fps_most);
}

static void print_mode(const sf_device_mode *m) {
    char size[64], rate[64];
    size_text(m, size);
    rate_text(m, rate);
    printf("  %-5s %-6s %-32s %s\n", m->fourcc, m->supported ? sf_pixel_format_name(m->format) : "-", size,
           m->supported ? rate : "not read by splatfit");
}

static void print_devices(const sf_devices *devices) {
    sf_device_info info;
    sf_device_mode mode;
    size_t i = 0;
    for (; !sf_devices_get(devices, i, &info); i++) {
        printf("%s  %s%s%s%s%s\n", info.source, info.name, *info.bus ? ", " : "", info.bus,
               *info.serial ? ", serial " : "", info.serial);
        for (size_t m = 0; !sf_devices_get_mode(devices, i, m, &mode); m++) print_mode(&mode);
    }
    if (!i) printf("no camera was found; folder:DIR, pipe:- and sim:studio are sources too\n");
}

static json_t *mode_json(const sf_device_mode *m) {
    json_t *json = json_pack("{s:o, s:b, s:i, s:i, s:f, s:f}", "fourcc", app_json_text(m->fourcc),
                             "supported", m->supported, "width", (int)m->width, "height", (int)m->height,
                             "fps_least", m->fps_least, "fps_most", m->fps_most);
    if (m->supported) json_object_set_new(json, "format", json_string(sf_pixel_format_name(m->format)));
    if (m->width_most) {
        json_object_set_new(json, "width_most", json_integer(m->width_most));
        json_object_set_new(json, "height_most", json_integer(m->height_most));
        json_object_set_new(json, "width_step", json_integer(m->width_step));
        json_object_set_new(json, "height_step", json_integer(m->height_step));
    }
    return json;
}

static json_t *devices_json(const sf_devices *devices) {
    json_t *list = json_array();
    sf_device_info info;
    sf_device_mode mode;
    for (size_t i = 0; !sf_devices_get(devices, i, &info); i++) {
        json_t *modes = json_array();
        for (size_t m = 0; !sf_devices_get_mode(devices, i, m, &mode); m++)
            json_array_append_new(modes, mode_json(&mode));
        json_array_append_new(list,
                              json_pack("{s:o, s:o, s:o, s:o, s:o}", "source", app_json_text(info.source),
                                        "name", app_json_text(info.name), "bus", app_json_text(info.bus),
                                        "serial", app_json_text(info.serial), "modes", modes));
    }
    return json_pack("{s:o}", "devices", list);
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    sf_devices *devices = NULL;
    int error = app_context(a, &ctx);
    if (error) return error;
    if (sf_devices_find(ctx, &devices))
        error = app_fail(a, ctx);
    else if (args_value(a, "json"))
        error = app_write_json(a, ctx, "-", devices_json(devices));
    else
        print_devices(devices);
    sf_devices_free(&devices);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option own_options[] = {
    {"json", 0, NULL, "print JSON"},
    {0},
};

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_devices = {
    .name = "devices",
    .synopsis = "[OPTIONS]",
    .summary = "Lists the cameras of this machine: each format and size with its rates.",
    .tables = tables,
    .least = 0,
    .most = 0,
    .run = run,
};
