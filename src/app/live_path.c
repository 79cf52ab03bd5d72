/* live_path.c - the path of a live fit's camera: kept, written, compared with the frames' own poses. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "live.h"

int path_note(live_path *p, const args *a, sf_live *live) {
    sf_live_frame f;
    sf_live_get_frame(live, &f);
    if (f.number == p->last_frame) return 0;
    p->last_frame = f.number;
    if (f.from == SF_POSE_NONE) return 0;
    if (p->count == p->capacity) {
        size_t more = p->capacity ? 2 * p->capacity : 1024;
        path_step *steps = realloc(p->steps, more * sizeof *steps);
        if (!steps) return app_say(a, "trajectory", "out of memory");
        p->steps = steps, p->capacity = more;
    }
    path_step *s = &p->steps[p->count++];
    *s = (path_step){
        .time = 1e-9 * (double)f.time_ns, .camera = f.camera, .truth = f.truth, .has_truth = f.has_truth};
    sf_scene_get_origin(sf_live_scene(live), s->origin);
    return 0;
}

int path_write(const live_path *p, const args *a, sf_context *ctx, const sf_live *live) {
    const char *file = app_output(a, "trajectory");
    sf_similarity world;
    if (!file) return 0;
    size_t room = APP_POSE_LINE * (p->count + 1), n = 0;
    char *text = malloc(room);
    if (!text) return app_say(a, file, "out of memory");
    n += app_pose_header(text);
    int moves = !sf_live_get_world(live, &world);
    for (size_t i = 0; i < p->count; i++) {
        const path_step *s = &p->steps[i];
        sf_camera camera = s->camera;
        double R_wc[9], quat[4], center[3];
        if (moves) sf_camera_transform(&camera, &world);
        for (int k = 0; k < 9; k++) R_wc[k] = camera.R_cw[3 * (k % 3) + k / 3];
        sf_rotation_to_quat(R_wc, quat);
        sf_camera_center(&camera, center);
        for (int k = 0; k < 3; k++) center[k] += s->origin[k]; /* the path is the world's */
        n += app_pose_line(text + n, s->time, center, quat);
    }
    sf_status status = sf_write_file(ctx, file, text, n);
    free(text);
    return status ? app_fail(a, ctx) : 0;
}

static void compare(const sf_camera *camera, const sf_camera *truth, double *degrees, double *distance) {
    double here[3], there[3], trace = 0, squares = 0;
    sf_camera_center(camera, here);
    sf_camera_center(truth, there);
    for (int k = 0; k < 9; k++) trace += truth->R_cw[k] * camera->R_cw[k];
    for (int k = 0; k < 3; k++) squares += pow(there[k] - here[k], 2);
    *degrees = acos(fmin(fmax((trace - 1) / 2, -1), 1)) * 57.29577951308232;
    *distance = sqrt(squares);
}

/* Cameras and their truths, n of them; `errors` has room for 2 n. */
static int measure(sf_camera *cameras, const sf_camera *truths, size_t n, int own_world, double *errors,
                   path_error *error) {
    if (!n || (own_world && !sf_similarity_between(cameras, truths, n, &error->similarity))) return 0;
    for (size_t i = 0; i < n; i++) {
        if (own_world) sf_camera_transform(&cameras[i], &error->similarity);
        compare(&cameras[i], &truths[i], &errors[i], &errors[n + i]);
        error->most_degrees = fmax(error->most_degrees, errors[i]);
        error->most_distance = fmax(error->most_distance, errors[n + i]);
    }
    error->degrees = app_median(errors, n);
    error->distance = app_median(errors + n, n);
    return 1;
}

/* Room to compare n cameras. */
typedef struct comparison {
    sf_camera *cameras, *truths;
    double *errors; /* [2 n]: degrees, then distances */
} comparison;

static int make_room(comparison *c, size_t n) {
    c->cameras = malloc((n + 1) * sizeof *c->cameras), c->truths = malloc((n + 1) * sizeof *c->truths);
    c->errors = malloc((n + 1) * 2 * sizeof *c->errors);
    return c->cameras && c->truths && c->errors;
}

static void free_room(comparison *c) {
    free(c->cameras);
    free(c->truths);
    free(c->errors);
}

size_t path_compare(const live_path *p, int own_world, path_error *error) {
    comparison c;
    size_t n = 0;
    int ready = make_room(&c, p->count);
    *error = (path_error){.degrees = NAN, .distance = NAN};
    for (size_t i = 0; i < p->count && ready; i++)
        if (p->steps[i].has_truth) c.cameras[n] = p->steps[i].camera, c.truths[n++] = p->steps[i].truth;
    ready = ready && measure(c.cameras, c.truths, n, own_world, c.errors, error);
    free_room(&c);
    return ready ? n : 0;
}

size_t keyframes_compare(const sf_live *live, int own_world, path_error *error, json_t **list) {
    sf_live_progress p;
    sf_live_keyframe k;
    comparison c;
    size_t n = 0;
    sf_live_get_progress(live, &p);
    double *times = malloc((p.keyframes + 1) * sizeof *times);
    int ready = make_room(&c, p.keyframes) && times;
    *error = (path_error){.degrees = NAN, .distance = NAN};
    for (size_t i = 0; ready && sf_live_get_keyframes(live, i, 1, &k); i++)
        if (k.has_truth)
            c.cameras[n] = k.camera, c.truths[n] = k.truth, times[n++] = 1e-9 * (double)k.time_ns;
    ready = ready && measure(c.cameras, c.truths, n, own_world, c.errors, error);
    if (list) *list = json_array();
    for (size_t i = 0; ready && list && i < n; i++) {
        double degrees, distance;
        compare(&c.cameras[i], &c.truths[i], &degrees, &distance); /* medians sort the errors */
        json_array_append_new(
            *list, json_pack("{s:f, s:f, s:f}", "time", times[i], "degrees", degrees, "distance", distance));
    }
    free_room(&c);
    free(times);
    return ready ? n : 0;
}

json_t *path_similarity_json(const path_error *e) {
    return json_pack("{s:f, s:o, s:o}", "scale", e->similarity.scale, "rotation",
                     app_json_numbers(e->similarity.R, 9), "move", app_json_numbers(e->similarity.move, 3));
}

void path_free(live_path *p) {
    free(p->steps);
    *p = (live_path){0};
}
