/* film.c - frames of a video become the photos of a project. */
#include "film.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

typedef struct film {
    progress_line *line;
} film;

static int tell(void *user, sf_film_stage stage, size_t done, size_t all) {
    film *f = user;
    char text[128];
    if (f->line->kind == PROGRESS_JSON || !progress_due(f->line, app_seconds(), done == all)) return 0;
    if (all)
        snprintf(text, sizeof text, "%s: %zu of %zu",
                 stage == SF_FILM_LOOK ? "frames looked at" : "frames taken", done, all);
    else
        snprintf(text, sizeof text, "frames looked at: %zu", done);
    progress_text(f->line, text);
    return 0; /* a signal ends the program: the folder of the frames is not there before all of them are */
}

char *film_project(const char *video) {
    char *path = malloc(strlen(video) + 16);
    if (path) sprintf(path, "%s.project", video);
    return path;
}

int film_take(const args *a, sf_context *ctx, const char *video, const char *project, const film_options *o) {
    struct stat st;
    sf_film_info info;
    sf_film_options options = sf_film_options_default();
    film f = {.line = o->line};
    size_t size = strlen(project) + 16;
    char *images = malloc(size);
    if (!images) return app_say(a, video, "out of memory");
    snprintf(images, size, "%s/images", project);
    int quiet = args_value(a, "quiet") || o->line->kind == PROGRESS_JSON, error = 0;
    if (!o->frames && !stat(images, &st)) {
        if (!quiet)
            fprintf(o->out, "%s: is there: its pictures are used; remove it to take frames of %s anew\n",
                    images, video);
    } else {
        options.frames = o->frames, options.side = o->side;
        options.progress = tell, options.user = &f;
        error = app_make_folder(a, project);
        if (!error && sf_film_take_frames(ctx, video, images, &options, &info)) error = app_fail(a, ctx);
        progress_break(o->line);
        if (error)
            rmdir(project); /* where it is empty */
        else if (!quiet)
            fprintf(o->out, "%zu of %zu frames taken, %dx%d: %s\n", info.taken, info.frames, info.width,
                    info.height, images);
    }
    free(images);
    return error;
}
