/* live_source.c - see live_source.h. */
#include "live_source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Of videos and folders: frames of a second, steps after each, and the longest side, px, unless told. */
enum { FILM_RATE = 15, FILM_STEPS = 6, FILM_SIDE = 640 };

/* Whether the scheme is named, or a path that sf_source_open takes as one. */
static int is_folder(const char *name) {
    struct stat st;
    return !strncmp(name, "folder:", 7) || (!stat(name, &st) && S_ISDIR(st.st_mode));
}

static int is_video(const char *name) { return !strncmp(name, "video:", 6) || sf_film_is(name); }

/* The name, of a video with its rate and size where it does not tell them; free() it. */
static char *full_name(const args *a) {
    const char *name = a->positional[0], *rate = args_value(a, "track-rate");
    char *full = malloc(strlen(name) + 96), fallback[16];
    snprintf(fallback, sizeof fallback, "%d", FILM_RATE);
    if (!full) return NULL;
    strcpy(full, name);
    if (is_video(name) && !strstr(name, "rate="))
        sprintf(full + strlen(full), "%crate=%s", strchr(name, '?') ? '&' : '?', rate ? rate : fallback);
    return full;
}

/* The lens of a video is that of its own size, and is scaled to that of its frames. */
static int scale_lens(const args *a, sf_context *ctx, const sf_source_info *info, sf_lens *lens) {
    sf_calibration known;
    if (!args_value(a, "lens")) return 0;
    if (sf_calibration_load(ctx, args_value(a, "lens"), &known)) return app_fail(a, ctx);
    double x = (double)info->width / known.width, y = (double)info->height / known.height;
    *lens = known.lens;
    if (!known.width) return 0;
    if (x / y < 0.99 || x / y > 1.01)
        return args_error(a->command, "%s: size: %d x %d has not the shape of the video's frames, %d x %d",
                          args_value(a, "lens"), (int)known.width, (int)known.height, (int)info->width,
                          (int)info->height);
    lens->fx *= x, lens->cx *= x, lens->fy *= y, lens->cy *= y;
    return 0;
}

int live_open_source(const args *a, sf_context *ctx, sf_live_options *options, sf_source **source) {
    char *name = full_name(a);
    sf_source_info info;
    if (!name) return app_say(a, a->positional[0], "out of memory");
    sf_status status = sf_source_open(ctx, name, source);
    free(name);
    if (status) return app_fail(a, ctx);
    sf_source_describe(*source, &info);
    int film = is_video(a->positional[0]), longer = info.width > info.height ? info.width : info.height;
    if ((film || is_folder(a->positional[0])) && !info.live && !args_value(a, "seconds")) {
        if (!args_value(a, "steps-per-frame")) options->steps_per_frame = FILM_STEPS;
        if (!args_value(a, "downscale") && !film) options->downscale = (longer + FILM_SIDE - 1) / FILM_SIDE;
        if (options->downscale > 16) options->downscale = 16;
    }
    const char *lens = args_value(a, "lens");
    options->find_lens = lens && !strcmp(lens, "find");
    if (options->find_lens) return 0;
    return film ? scale_lens(a, ctx, &info, &options->lens) : app_lens(a, ctx, *source, &options->lens);
}

const char *live_project(const args *a) {
    const char *path = app_output(a, "cameras");
    struct stat st;
    size_t length = path ? strlen(path) : 0;
    if (!path || (length > 5 && !strcmp(path + length - 5, ".json"))) return NULL;
    return strcmp(path, "-") && (stat(path, &st) || S_ISDIR(st.st_mode)) ? path : NULL;
}

int live_check_project(const args *a, const char *project) {
    char *images = malloc(strlen(project) + 16);
    struct stat st;
    if (!images) return app_say(a, project, "out of memory");
    sprintf(images, "%s/images", project);
    int error = !stat(images, &st)
                    ? app_say(a, images, "is there already: remove it, or give another project")
                : stat(project, &st) ? app_check_output(a, project)
                                     : app_check_output(a, images);
    free(images);
    return error;
}
