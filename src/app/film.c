/* film.c - frames of a video become the photos of a project. */
#include "film.h"
#include "photo_project.h"

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

/* Where a project says of which video its frames are. free() it. */
static char *note_of(const char *project) {
    char *path = malloc(strlen(project) + 16);
    if (path) sprintf(path, "%s/video.txt", project);
    return path;
}

int film_compare(const args *a, sf_context *ctx, const char *video, const char *project,
                 sf_photos_change *change) {
    char *note = note_of(project);
    if (!note) return app_say(a, video, "out of memory");
    int error = sf_sfm_compare_photos(ctx, video, NULL, note, change) ? app_fail(a, ctx) : 0;
    free(note);
    return error;
}

static int write_note(const args *a, sf_context *ctx, const char *video, const char *project) {
    char *note = note_of(project);
    if (!note) return app_say(a, video, "out of memory");
    int error = sf_sfm_note_photos(ctx, video, NULL, note) ? app_fail(a, ctx) : 0;
    free(note);
    return error;
}

/* Frames of another video are kept under another name. 0 or an exit code. */
static int keep_other_frames(const args *a, sf_context *ctx, const char *video, const char *project) {
    sf_photos_change change;
    int error = film_compare(a, ctx, video, project, &change);
    return !error && change.replaced ? project_keep(a, project, "images") : error;
}

static int take(const args *a, sf_context *ctx, const char *video, const char *project, const char *images,
                const film_options *o) {
    sf_film_info info;
    sf_film_options options = sf_film_options_default();
    film f = {.line = o->line};
    options.frames = o->frames, options.side = o->side;
    options.progress = tell, options.user = &f;
    int error = app_make_folder(a, project);
    if (!error && sf_film_take_frames(ctx, video, images, &options, &info)) error = app_fail(a, ctx);
    progress_break(o->line);
    if (error) rmdir(project); /* where it is empty */
    if (!error) error = write_note(a, ctx, video, project);
    if (!error && !args_value(a, "quiet") && o->line->kind != PROGRESS_JSON)
        fprintf(o->out, "%zu of %zu frames taken, %dx%d: %s\n", info.taken, info.frames, info.width,
                info.height, images);
    return error;
}

int film_take(const args *a, sf_context *ctx, const char *video, const char *project, const film_options *o) {
    struct stat st;
    char *images = malloc(strlen(project) + 16);
    if (!images) return app_say(a, video, "out of memory");
    sprintf(images, "%s/images", project);
    int error = o->frames ? 0 : keep_other_frames(a, ctx, video, project);
    if (!error && (o->frames || stat(images, &st)))
        error = take(a, ctx, video, project, images, o);
    else if (!error && !args_value(a, "quiet") && o->line->kind != PROGRESS_JSON)
        fprintf(o->out, "%s: is there: its pictures are used; remove it to take frames of %s anew\n", images,
                video);
    free(images);
    return error;
}
