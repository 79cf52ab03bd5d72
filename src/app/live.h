/* live.h - the page of a live fit, and the camera's path. */
#ifndef APP_LIVE_H
#define APP_LIVE_H

#include "../preview/preview.h"
#include "app.h"

typedef struct page {
    sf_preview *preview;     /* NULL: none is served */
    double next, next_model; /* s of the run */
    float *rgb;              /* a render */
    uint8_t *bytes;
    size_t capacity; /* pixels of both */
} page;

typedef enum page_word {
    PAGE_NOTHING,
    PAGE_PAUSE,
    PAGE_GO_ON,
    PAGE_SAVE,
    PAGE_RESET,
    PAGE_LOCK,
    PAGE_UNLOCK
} page_word;

/* Serves it as --listen and --token say, and says where. An address that nobody asked for and that is taken,
 * or a build without it, is no failure. 0 or an exit code. */
int page_open(page *p, const args *a, sf_context *ctx);
void page_close(page *p);
/* Whether it is time to show something new. */
int page_due(page *p, double seconds);
/* Shows the frame, the render from there, the figures (takes the reference) and now and then the model. */
void page_show(page *p, sf_live *live, json_t *figures);
/* The next button that somebody pressed. */
page_word page_command(page *p);

/* A frame whose pose was found. */
typedef struct path_step {
    double time; /* s */
    sf_camera camera, truth;
    double origin[3]; /* of their coordinates, in the world */
    int has_truth;    /* the frame told its own pose, which was not used */
} path_step;

/* The camera's path so far. */
typedef struct live_path {
    path_step *steps;
    size_t count, capacity;
    uint64_t last_frame;
} live_path;

/* How far poses are off those that the frames told: medians, and the most; distances in the unit of the
 * frames' own poses. */
typedef struct path_error {
    double degrees, distance, most_degrees, most_distance;
    sf_similarity similarity; /* from the path's world to theirs */
} path_error;

/* Keeps the pose of the newest frame. 0 or an exit code. */
int path_note(live_path *path, const args *a, sf_live *live);
/* Writes --trajectory, if it is asked for. 0 or an exit code. */
int path_write(const live_path *path, const args *a, sf_context *ctx, const sf_live *live);
/* own_world: the path is compared after the similarity that fits best. Returns how many poses were compared.
 */
size_t path_compare(const live_path *path, int own_world, path_error *error);
/* The same of the keyframes as they are known by now. *list: of each the time and how far it is off, NULL:
 * not wanted. */
size_t keyframes_compare(const sf_live *live, int own_world, path_error *error, json_t **list);
json_t *path_similarity_json(const path_error *error);
void path_free(live_path *path);

#endif
