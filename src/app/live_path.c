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

/* The n steps with a truth: cameras of both worlds, and room for the errors. */
static size_t measure(const live_path *p, int own_world, sf_camera *cameras, sf_camera *truths,
                      double *errors, path_error *error) {
    size_t n = 0;
    for (size_t i = 0; i < p->count; i++)
        if (p->steps[i].has_truth) cameras[n] = p->steps[i].camera, truths[n++] = p->steps[i].truth;
    if (!n || (own_world && !sf_similarity_between(cameras, truths, n, &error->similarity))) return 0;
    for (size_t i = 0; i < n; i++) {
        if (own_world) sf_camera_transform(&cameras[i], &error->similarity);
        compare(&cameras[i], &truths[i], &errors[i], &errors[n + i]);
    }
    error->degrees = app_median(errors, n);
    error->distance = app_median(errors + n, n);
    return n;
}

size_t path_compare(const live_path *p, int own_world, path_error *error) {
    sf_camera *cameras = malloc((p->count + 1) * sizeof *cameras),
              *truths = malloc((p->count + 1) * sizeof *truths);
    double *errors = malloc((p->count + 1) * 2 * sizeof *errors);
    *error = (path_error){.degrees = NAN, .distance = NAN};
    size_t n = cameras && truths && errors ? measure(p, own_world, cameras, truths, errors, error) : 0;
    free(cameras);
    free(truths);
    free(errors);
    return n;
}

json_t *path_similarity_json(const path_error *e) {
    return json_pack("{s:f, s:o, s:o}", "scale", e->similarity.scale, "rotation",
                     app_json_numbers(e->similarity.R, 9), "move", app_json_numbers(e->similarity.move, 3));
}

void path_free(live_path *p) {
    free(p->steps);
    *p = (live_path){0};
}
