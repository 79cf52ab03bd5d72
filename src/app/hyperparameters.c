/* hyperparameters.c - the hyperparameters of a fit, from the command line and into a log. */
#include <stdlib.h>
#include <string.h>

#include "app.h"

/* --background R,G,B stands for the option color and its three components. */
static int set_background(const args *a, sf_fit_options *options, const char *text) {
    float color[3];
    if (!app_color(text, color)) {
        args_error(a->command,
                   "--background: \"%s\" is neither R,G,B in 0..1 nor black, white, random or auto", text);
        return EXIT_USAGE;
    }
    options->background = SF_BACKGROUND_COLOR;
    options->background_red = (double)color[0];
    options->background_green = (double)color[1];
    options->background_blue = (double)color[2];
    return 0;
}

static int set_option(const args *a, sf_context *ctx, sf_fit_options *options, const char *name,
                      const char *text) {
    if (!strcmp(name, "background") && strchr(text, ',')) return set_background(a, options, text);
    if (!sf_fit_options_set(ctx, options, name, text)) return 0;
    app_fail(a, ctx);
    return EXIT_USAGE;
}

int app_fit_options(const args *a, sf_context *ctx, sf_fit_options *options) {
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        const char *text = args_value(a, info.name);
        int error = text ? set_option(a, ctx, options, info.name, text) : 0;
        if (error) return error;
    }
    return 0;
}

json_t *app_options_json(const sf_fit_options *options) {
    json_t *object = json_object();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char text[64];
        sf_fit_options_get(options, info.name, text, sizeof text);
        json_t *value = info.kind == SF_KIND_ENUM   ? json_string(text)
                        : info.kind == SF_KIND_REAL ? json_real(strtod(text, NULL))
                                                    : json_integer(strtoll(text, NULL, 10));
        json_object_set_new(object, info.name, value);
    }
    return object;
}
