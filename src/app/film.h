/* film.h - frames of a video become the photos of a project. */
#ifndef APP_FILM_H
#define APP_FILM_H

#include <splatfit/sfm.h>

#include "app.h"

typedef struct film_options {
    int frames;          /* at most; 0: as many as the video is worth */
    int side;            /* px */
    progress_line *line; /* started */
    FILE *out;           /* for what is said at the end */
} film_options;

/* NAME.mp4.project beside a video NAME.mp4; free() it. NULL: no memory. */
char *film_project(const char *video);

/* How a video compares with the one that a project's frames are of. 0 or an exit code. */
int film_compare(const args *a, sf_context *ctx, const char *video, const char *project,
                 sf_photos_change *change);

/* Takes frames into images of the project's folder, which is made; where there are images already they stay,
 * unless a number of frames is asked for, or they are known to be of another video: then they are kept under
 * another name. 0 or an exit code. */
int film_take(const args *a, sf_context *ctx, const char *video, const char *project, const film_options *o);

#endif
