/* video.c - frames of a video as photos: all are judged in a small size, then the chosen ones are written. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../base/file.h"
#include "../io/ffmpeg.h"
#include "../io/no_project.h"
#include "../io/paths.h"
#include "../io/picture.h"
#include "frame_choice.h"

#include <splatfit/sfm.h>

enum {
    LOOK_SIDE = 640,   /* px, of frames that are judged */
    MOST_TAKEN = 5000, /* frames: what the filter's text holds */
    FAULT = 256
};

/* In the picture's longer side: a picture that moves less shows no depth. */
#define STILL 0.03

typedef struct video {
    sf_context *ctx;
    const char *path;
    const sf_film_options *options;
    sf_film_facts facts;
    sf_frame_judged *frames;
    size_t count, capacity;
    size_t *chosen;
    size_t chosen_count;
    char fault[FAULT]; /* ffmpeg's, which may have gone on */
    sf_film_info info;
} video;

int sf_film_is(const char *path) { return sf_is_video(path); }

sf_film_options sf_film_options_default(void) { return (sf_film_options){.side = 1600, .quality = 95}; }

static sf_status check_options(sf_context *ctx, const sf_film_options *o) {
    if (o->frames && (o->frames < 2 || o->frames > MOST_TAKEN))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frames: %d is not 0 or in 2..%d", o->frames, MOST_TAKEN);
    if (o->side < 64 || o->side > 28000)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "side: %d is not in 64..28000", o->side);
    if (o->quality < 1 || o->quality > 100)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "quality: %d is not in 1..100", o->quality);
    return SF_OK;
}

static int tell(const video *v, sf_film_stage stage, size_t done, size_t all) {
    return v->options->progress && v->options->progress(v->options->user, stage, done, all);
}

/* ---- 1. all frames ---- */

static sf_status judge_frames(video *v, sf_frame_pipe *pipe) {
    sf_frame_judge judge;
    sf_status status = SF_OK;
    sf_frame_judge_begin(&judge, v->ctx);
    while (!status && !(status = sf_frame_pipe_next(pipe))) {
        status = sf_grow(v->ctx, &v->frames, &v->capacity, v->count, v->count + 1, sizeof *v->frames);
        if (!status)
            status =
                sf_frame_judge_next(&judge, pipe->pixels, pipe->width, pipe->height, &v->frames[v->count]);
        if (status) break;
        size_t all = (size_t)v->facts.frames;
        v->count++;
        if (tell(v, SF_FILM_LOOK, v->count, all > v->count ? all : 0)) status = SF_ERR_CANCELLED;
    }
    sf_frame_judge_end(&judge);
    return status == SF_ERR_END ? SF_OK : status;
}

static sf_status look(video *v) {
    char filters[512];
    sf_frame_pipe pipe;
    sf_ffmpeg_scale(&v->facts, LOOK_SIDE, "area", filters, sizeof filters);
    sf_status status = sf_frame_pipe_open(&pipe, v->ctx, v->path, &v->facts, filters, 1);
    if (status) return status;
    status = judge_frames(v, &pipe);
    sf_frame_pipe_close(&pipe, v->fault, sizeof v->fault);
    if (!status && tell(v, SF_FILM_LOOK, v->count, v->count)) status = SF_ERR_CANCELLED;
    return status;
}

static sf_status choose(video *v) {
    double path = v->count ? v->frames[v->count - 1].path : 0;
    const char *why = *v->fault ? ": " : "";
    if (v->count < 2)
        return sf_fail(v->ctx, *v->fault ? SF_ERR_FORMAT : SF_ERR_EMPTY,
                       "%s: %zu frames can be read, which show no depth%s%s", v->path, v->count, why,
                       v->fault);
    if (path < STILL)
        return sf_fail(v->ctx, SF_ERR_EMPTY,
                       "%s: the picture hardly moves, by %.1f %% of its longer side in %zu frames: walk "
                       "around what is to be seen",
                       v->path, 100 * path, v->count);
    if (*v->fault)
        sf_log(v->ctx, SF_LOG_WARNING, "%s: is damaged: the %zu frames that can be read are used: %s",
               v->path, v->count, v->fault);
    size_t wanted = v->options->frames ? (size_t)v->options->frames : sf_frames_wanted(path);
    if (wanted > MOST_TAKEN) wanted = MOST_TAKEN;
    v->chosen = sf_alloc(v->ctx, wanted, sizeof *v->chosen);
    if (!v->chosen) return SF_ERR_MEMORY;
    v->chosen_count = sf_frames_choose(v->frames, v->count, wanted, v->chosen);
    v->info.frames = v->count, v->info.taken = v->chosen_count, v->info.path = path;
    return SF_OK;
}

/* ---- 2. those that are taken ---- */

static sf_status write_frame(video *v, const sf_frame_pipe *pipe, const char *folder, size_t number) {
    char name[64];
    uint8_t *file = NULL;
    size_t size;
    snprintf(name, sizeof name, "frame_%06zu.jpg", number);
    char *path = sf_path_join(v->ctx, folder, name);
    sf_status status = path ? sf_encode_jpeg_8(v->ctx, pipe->width, pipe->height, pipe->pixels,
                                               v->options->quality, &file, &size)
                            : SF_ERR_MEMORY;
    if (!status) status = sf_write_file_unsynced(v->ctx, path, file, size);
    sf_encoded_free(v->ctx, &file);
    sf_free(v->ctx, path);
    v->info.width = pipe->width, v->info.height = pipe->height;
    return status;
}

static sf_status write_frames(video *v, sf_frame_pipe *pipe, const char *folder) {
    for (size_t i = 0; i < v->chosen_count; i++) {
        sf_status status = sf_frame_pipe_next(pipe);
        if (status == SF_ERR_END)
            return sf_fail(v->ctx, SF_ERR_FORMAT, "%s: ffmpeg gives %zu of the %zu chosen frames", v->path, i,
                           v->chosen_count);
        if (!status) status = write_frame(v, pipe, folder, v->chosen[i]);
        if (status) return status;
        if (tell(v, SF_FILM_TAKE, i + 1, v->chosen_count)) return SF_ERR_CANCELLED;
    }
    return SF_OK;
}

/* "((eq(n,0)+eq(n,7))+eq(n,9))": ffmpeg's expressions hold about a hundred terms on one level. Returns the
 * length. */
static size_t put_terms(const size_t *numbers, size_t count, char *text) {
    if (count == 1) return (size_t)sprintf(text, "eq(n,%zu)", *numbers);
    size_t half = count / 2, n = 1;
    *text = '(';
    n += put_terms(numbers, half, text + n);
    text[n++] = '+';
    n += put_terms(numbers + half, count - half, text + n);
    text[n++] = ')', text[n] = 0;
    return n;
}

static char *take_filters(const video *v) {
    enum { TERM = 32, REST = 512 };
    size_t size = v->chosen_count * TERM + REST;
    char *text = sf_alloc(v->ctx, size, 1);
    if (!text) return NULL;
    size_t n = (size_t)sprintf(text, "select='");
    n += put_terms(v->chosen, v->chosen_count, text + n);
    n += (size_t)sprintf(text + n, "',");
    sf_ffmpeg_scale(&v->facts, v->options->side, "lanczos+accurate_rnd+full_chroma_int+full_chroma_inp",
                    text + n, size - n);
    return text;
}

static sf_status take(video *v, const char *folder) {
    sf_frame_pipe pipe;
    char fault[FAULT], *filters = take_filters(v);
    sf_status status =
        filters ? sf_frame_pipe_open(&pipe, v->ctx, v->path, &v->facts, filters, 3) : SF_ERR_MEMORY;
    sf_free(v->ctx, filters);
    if (status) return status;
    status = write_frames(v, &pipe, folder);
    sf_frame_pipe_close(&pipe, fault, sizeof fault);
    if (status == SF_ERR_FORMAT && *fault)
        return sf_fail(v->ctx, status, "%s: ffmpeg cannot take the chosen frames: %s", v->path, fault);
    return status;
}

/* ---- the folder ---- */

/* Removes frames that were left behind, and the folder if it is empty then. */
static void clear_folder(sf_context *ctx, const char *path) {
    const struct dirent *e;
    DIR *folder = opendir(path);
    while (folder && (e = readdir(folder))) {
        size_t length = strlen(e->d_name);
        char *file = length > 4 && !strncmp(e->d_name, "frame_", 6) && !strcmp(e->d_name + length - 4, ".jpg")
                         ? sf_path_join(ctx, path, e->d_name)
                         : NULL;
        if (file) unlink(file);
        sf_free(ctx, file);
    }
    if (folder) closedir(folder);
    rmdir(path);
}

static sf_status folder_fails(sf_context *ctx, const char *path) {
    return sf_fail(ctx, SF_ERR_IO, "%s: %s", path, strerror(errno));
}

/* The frames go to a folder beside, which takes its name when it is whole. */
static sf_status take_into(video *v, const char *folder) {
    size_t size = strlen(folder) + 8;
    char *part = sf_alloc(v->ctx, size, 1);
    if (!part) return SF_ERR_MEMORY;
    snprintf(part, size, "%s.part", folder);
    clear_folder(v->ctx, part);
    sf_status status = mkdir(part, 0777) ? folder_fails(v->ctx, part) : take(v, part);
    if (!status && rename(part, folder)) status = folder_fails(v->ctx, folder);
    if (status) clear_folder(v->ctx, part);
    sf_free(v->ctx, part);
    return status;
}

sf_status sf_film_take_frames(sf_context *ctx, const char *path, const char *folder,
                              const sf_film_options *options, sf_film_info *info) {
    sf_film_options o = options ? *options : sf_film_options_default();
    video v = {.ctx = ctx, .path = path, .options = &o};
    struct stat st;
    sf_status status = check_options(ctx, &o);
    if (!status && !stat(folder, &st))
        status = sf_fail(ctx, SF_ERR_IO, "%s: is there already: remove it, or give another", folder);
    if (!status) status = sf_ffmpeg_probe(ctx, path, &v.facts);
    if (!status && v.facts.is_hdr)
        sf_log(ctx, SF_LOG_WARNING, "%s: is of high dynamic range: colours will look pale", path);
    if (!status) status = look(&v);
    if (!status) status = choose(&v);
    if (!status) status = take_into(&v, folder);
    if (!status && info) *info = v.info;
    sf_free(ctx, v.frames);
    sf_free(ctx, v.chosen);
    return status;
}
