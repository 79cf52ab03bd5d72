/* pictures.c - where rendered pictures go. */
#include "pictures.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const arg_option picture_options[] = {
    {"out", 'o', "WHERE",
     "folder for pictures (made if it is missing), or a file NAME.y4m; -: y4m to standard output"},
    {"format", 0, "NAME", "png or y4m (YUV4MPEG2, for ffmpeg -i -); default: chosen by --out"},
    {"chroma", 0, "NAME", "y4m: 420 or 444 (420)"},
    {"matrix", 0, "NAME",
     "y4m: BT.601 or 709, limited range; the stream cannot state it, readers assume 601 (601)"},
    {"depth", 0, NULL,
     "also write NAME.depth.png, 16 bits: the mean z of the Gaussians at a pixel, weighted as their colours; "
     "0 where they hide less than half of the background"},
    {"depth-unit", 0, "X", "world units for each step of depth (0.001)"},
    {"transmittance", 0, NULL,
     "also write NAME.transmittance.png, 16 bits: 65535 where the background is fully visible"},
    {0},
};

/* Of what is written: depth where the background is hidden by as much. */
#define HIDDEN 0.5f

/* Which of two words an option is: 0 or 1, *which left alone where it was not given. */
static int read_word(const args *a, const char *name, const char *first, const char *second, int *which) {
    const char *text = args_value(a, name);
    if (!text || !strcmp(text, first) || !strcmp(text, second)) {
        if (text) *which = strcmp(text, first) != 0;
        return 0;
    }
    args_error(a->command, "--%s: \"%s\" is neither %s nor %s", name, text, first, second);
    return EXIT_USAGE;
}

static int ends_in(const char *text, const char *end) {
    size_t n = strlen(text), m = strlen(end);
    return n >= m && !strcmp(text + n - m, end);
}

/* What goes with the other kind of output. */
static int refuse_others(const args *a, int streams) {
    static const char *const of_streams[] = {"chroma", "matrix", NULL}, *const of_files[] = {
                                                                            "depth", "depth-unit",
                                                                            "transmittance", NULL};
    for (const char *const *name = streams ? of_files : of_streams; *name; name++) {
        if (!args_value(a, *name)) continue;
        args_error(a->command, "--%s: is of %s", *name,
                   streams ? "pictures, not of a stream" : "a stream: --format y4m");
        return EXIT_USAGE;
    }
    if (args_value(a, "depth-unit") && !args_value(a, "depth")) {
        app_say(a, "--depth-unit", "goes with --depth");
        return EXIT_USAGE;
    }
    return 0;
}

static int read_options(const args *a, pictures *p) {
    int chroma = 0, matrix = 0;
    p->streams = !strcmp(p->out, "-") || ends_in(p->out, ".y4m");
    p->depth = args_value(a, "depth") != NULL;
    p->transmittance = args_value(a, "transmittance") != NULL;
    p->depth_unit = 0.001;
    int error = read_word(a, "format", "png", "y4m", &p->streams);
    if (!error) error = read_word(a, "chroma", "420", "444", &chroma);
    if (!error) error = read_word(a, "matrix", "601", "709", &matrix);
    if (!error) error = refuse_others(a, p->streams);
    if (!error) error = args_numbers(a, "depth-unit", 1, &p->depth_unit);
    p->options.chroma = chroma ? SF_VIDEO_444 : SF_VIDEO_420;
    p->options.matrix = matrix ? SF_YUV_709 : SF_YUV_601;
    if (error || p->depth_unit > 0) return error;
    app_say(a, "--depth-unit", "is not above 0");
    return EXIT_USAGE;
}

int pictures_begin(const args *a, sf_context *ctx, int rate, pictures *p) {
    *p = (pictures){.a = a, .ctx = ctx, .out = args_value(a, "out"), .options = sf_video_options_default()};
    if (!p->out) {
        app_say(a, "--out WHERE", "is needed: the folder for the pictures, or a file .y4m");
        return EXIT_USAGE;
    }
    int error = read_options(a, p);
    p->options.rate = rate;
    if (!error && !p->streams && !strcmp(p->out, "-")) {
        app_say(a, "--out", "PNG files go to a folder, not to standard output");
        error = EXIT_USAGE;
    }
    return error || !p->streams ? error : app_check_output(a, p->out);
}

/* ---- One picture ---- */

static int make_room(pictures *p, size_t pixels) {
    if (pixels <= p->room) return 0;
    free(p->values);
    free(p->grey);
    p->values = calloc(pixels, 5 * sizeof *p->values);
    p->grey = calloc(pixels, sizeof *p->grey);
    p->room = p->values && p->grey ? pixels : 0;
    return p->room ? 0 : app_say(p->a, "picture", "out of memory");
}

static char *file_name(const pictures *p, const char *name, const char *end) {
    size_t room = strlen(p->out) + strlen(name) + strlen(end) + 2;
    char *path = malloc(room);
    if (path) snprintf(path, room, "%s/%s%s", p->out, name, end);
    return path;
}

char *pictures_path(const pictures *p, const char *name) { return file_name(p, name, ".png"); }

/* The mean depth: the sum of w z, by the sum of w. */
static void fill_depth(pictures *p, size_t pixels) {
    const float *light = p->values + 3 * pixels, *sum = p->values + 4 * pixels;
    for (size_t i = 0; i < pixels; i++) {
        float hidden = 1 - light[i];
        double steps = hidden >= HIDDEN ? floor((double)sum[i] / (double)hidden / p->depth_unit + 0.5) : 0;
        p->saturated += steps > 65535;
        p->grey[i] = (uint16_t)fmin(fmax(steps, 0), 65535);
    }
}

static void fill_transmittance(pictures *p, size_t pixels) {
    const float *light = p->values + 3 * pixels;
    for (size_t i = 0; i < pixels; i++) p->grey[i] = (uint16_t)(fminf(fmaxf(light[i], 0), 1) * 65535 + 0.5f);
}

static int write_grey(pictures *p, const sf_camera *c, const char *name, const char *end) {
    char *path = file_name(p, name, end);
    if (!path) return app_say(p->a, name, "out of memory");
    int error = sf_write_png_grey16(p->ctx, path, c->width, c->height, p->grey) ? app_fail(p->a, p->ctx) : 0;
    free(path);
    return error;
}

static int write_files(pictures *p, const sf_camera *c, const char *name) {
    size_t pixels = (size_t)c->width * (size_t)c->height;
    char *path = file_name(p, name, ".png");
    if (!path) return app_say(p->a, name, "out of memory");
    int error = app_make_folders(p->a, path);
    if (!error && sf_write_png(p->ctx, path, c->width, c->height, p->values)) error = app_fail(p->a, p->ctx);
    free(path);
    if (!error && p->depth) {
        fill_depth(p, pixels);
        error = write_grey(p, c, name, ".depth.png");
    }
    if (!error && p->transmittance) {
        fill_transmittance(p, pixels);
        error = write_grey(p, c, name, ".transmittance.png");
    }
    return error;
}

static int write_frame(pictures *p, const sf_camera *c, const char *name) {
    if (!p->video) {
        p->options.width = c->width, p->options.height = c->height;
        if (sf_video_open(p->ctx, p->out, &p->options, &p->video)) return app_fail(p->a, p->ctx);
    }
    if (p->options.width != c->width || p->options.height != c->height)
        return app_say(p->a, name, "has another size than those before: a stream has one");
    return sf_video_add(p->video, p->values) ? app_fail(p->a, p->ctx) : 0;
}

int pictures_add(pictures *p, sf_renderer *renderer, const sf_model *model, const sf_camera *camera,
                 const sf_render_options *options, const char *name) {
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    int error = make_room(p, pixels);
    if (error) return error;
    sf_image_out out = {.rgb = p->values};
    if (p->depth || p->transmittance) out.transmittance = p->values + 3 * pixels;
    if (p->depth) out.depth = p->values + 4 * pixels;
    if (sf_render(renderer, model, camera, options, &out)) return app_fail(p->a, p->ctx);
    error = p->streams ? write_frame(p, camera, name) : write_files(p, camera, name);
    p->count += !error;
    return error;
}

int pictures_note(const pictures *p, const char *name, const char *text) {
    char *path = file_name(p, name, "");
    if (!path) return app_say(p->a, name, "out of memory");
    int error = app_make_folders(p->a, path);
    if (!error && sf_write_file(p->ctx, path, text, strlen(text))) error = app_fail(p->a, p->ctx);
    free(path);
    return error;
}

/* What the numbers of a depth picture mean. */
static int note_depth(const pictures *p) {
    char text[256];
    snprintf(text, sizeof text,
             "{\"unit\": %.17g, \"depth\": \"mean z of the camera's frame, weighted as colours are\", "
             "\"none\": 0, "
             "\"most\": 65535}\n",
             p->depth_unit);
    return pictures_note(p, "depth.json", text);
}

int pictures_end(pictures *p, int error) {
    if (!error && p->depth && p->count) error = note_depth(p);
    if (!error && p->saturated)
        fprintf(stderr, "warning: %zu pixels are further than %g, the most that --depth-unit %g can say\n",
                p->saturated, 65535 * p->depth_unit, p->depth_unit);
    if (error)
        sf_video_abandon(&p->video);
    else if (sf_video_close(&p->video))
        error = app_fail(p->a, p->ctx);
    free(p->values);
    free(p->grey);
    return error;
}
