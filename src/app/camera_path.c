/* camera_path.c - the cameras along a path. */
#include "camera_path.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MOST_FRAMES = 1000000, ORBIT_FRAMES = 240, KEYFRAMES = 16 };

/* Where no project says how large: the angle is from the top of the picture to its bottom. */
enum { WIDTH = 960, HEIGHT = 720 };
#define FIELD_OF_VIEW 50.0

const arg_option camera_path_options[] = {
    {"path", 0, "NAME",
     "render along a path: orbit (around the model), cameras (a smooth path through those of PROJECT) or a "
     "FILE of lines time x y z qx qy qz qw, camera to world (TUM)"},
    {"frames", 0, "N",
     "number of pictures; default: 240 for an orbit, --fps between two cameras, by the times of a FILE"},
    {"fps", 0, "N", "pictures a second, 1..1000 (30)"},
    {"size", 0, "WxH", "size of the pictures; default: that of PROJECT's, else 960x720"},
    {"fov", 0, "DEGREES", "vertical field of view; default: as in PROJECT, else 50"},
    {"keyframes", 0, "N",
     "cameras: number of PROJECT's cameras that the path passes, evenly chosen, 2..10000 (16)"},
    {"up", 0, "AXIS",
     "orbit: x, -x, y, -y, z or -z; default: as the cameras, else the normal of the model's main plane"},
    {"cameras", 0, "FILE",
     "orbit: the cameras of the fit, from which up, distance and elevation are taken (splat.cameras.json "
     "beside splat.ply, else cameras.json there)"},
    {"distance", 0, "X",
     "orbit: distance from the model's center, world units; 0: look around from the center; default: the "
     "cameras' median, else 0 if the model surrounds an empty center, else 2 radii"},
    {"elevation", 0, "DEGREES",
     "orbit: angle of the camera above the model's center, at distance 0 that of the line of sight; default: "
     "the cameras' median, else 20, at distance 0 0"},
    {0},
};

int camera_path_check(const args *a) {
    if (args_value(a, "path")) return 0;
    for (const arg_option *o = camera_path_options; o->name; o++) {
        if (!args_value(a, o->name)) continue;
        args_error(a->command, "--%s: goes with --path", o->name);
        return EXIT_USAGE;
    }
    return 0;
}

void camera_path_free(camera_path *s) {
    free(s->cameras);
    *s = (camera_path){0};
}

static int make_room(const args *a, camera_path *s, size_t count) {
    s->cameras = calloc(count, sizeof *s->cameras);
    s->count = s->cameras ? count : 0;
    return s->cameras ? 0 : app_say(a, "--frames", "out of memory");
}

/* ---- Lenses ---- */

static int read_size(const args *a, sf_camera *c) {
    const char *text = args_value(a, "size");
    int width, height, end = 0;
    if (!text) return 0;
    if (sscanf(text, "%5dx%5d%n", &width, &height, &end) != 2 || text[end] || width < 1 || height < 1 ||
        width > 16384 || height > 16384) {
        args_error(a->command, "--size: \"%s\" is not WxH of 1..16384 px", text);
        return EXIT_USAGE;
    }
    /* The same angle from top to bottom. */
    double scale = (double)height / c->height;
    c->cx = width / 2.0 + scale * (c->cx - c->width / 2.0);
    c->cy = height / 2.0 + scale * (c->cy - c->height / 2.0);
    c->fx *= scale, c->fy *= scale;
    c->width = width, c->height = height;
    return 0;
}

static double focal_of(int height, double degrees) {
    return height / 2.0 / tan(degrees * 0.008726646259971648);
}

/* The lens of all pictures, of a camera that stands nowhere yet. */
static int read_lens(const args *a, sf_scene *scene, sf_camera *c) {
    sf_view_info view;
    double degrees = FIELD_OF_VIEW;
    *c = (sf_camera){.width = WIDTH, .height = HEIGHT, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    c->fx = c->fy = focal_of(HEIGHT, degrees);
    if (scene && !sf_scene_get_view(scene, 0, &view)) *c = view.camera;
    int error = read_size(a, c);
    if (!error) error = args_numbers(a, "fov", 1, &degrees);
    if (error || !args_value(a, "fov")) return error;
    if (!(degrees >= 1 && degrees <= 170)) {
        app_say(a, "--fov", "is not in 1..170 degrees");
        return EXIT_USAGE;
    }
    c->fx = c->fy = focal_of(c->height, degrees);
    c->cx = c->width / 2.0, c->cy = c->height / 2.0;
    return 0;
}

static void place(const sf_camera *lens, const double R[9], const double t[3], sf_camera *c) {
    *c = *lens;
    memcpy(c->R_cw, R, sizeof c->R_cw);
    memcpy(c->t_cw, t, sizeof c->t_cw);
}

/* ---- Cameras that are known ---- */

static int scene_cameras(const args *a, sf_context *ctx, sf_scene *scene, sf_camera **cameras,
                         size_t *count) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    *cameras = malloc((info.views + 1) * sizeof **cameras);
    if (!*cameras) return app_say(a, "cameras", "out of memory");
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        if (sf_scene_get_view(scene, i, &view)) return app_fail(a, ctx);
        if (app_split_wants(a, "all", view.split)) (*cameras)[(*count)++] = view.camera;
    }
    return 0;
}

void camera_path_change_origin(sf_camera *c, const double origin[3], const double to[3]) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) c->t_cw[i] += c->R_cw[3 * i + k] * (to[k] - origin[k]);
}

/* Brings the model and cameras relative to `origin` into the same coordinates. */
static sf_status meet(sf_context *ctx, sf_model *model, const double origin[3], sf_camera *cameras,
                      size_t count) {
    double own[3];
    sf_scene *place = NULL;
    sf_model_get_origin(model, own);
    if (own[0] == 0 && own[1] == 0 && own[2] == 0) {
        sf_status status = sf_scene_create(ctx, &place);
        if (!status) status = sf_scene_set_origin(place, origin);
        if (!status) sf_scene_place_model(place, model);
        sf_scene_destroy(&place);
        return status;
    }
    for (size_t i = 0; i < count; i++) camera_path_change_origin(&cameras[i], origin, own);
    return SF_OK;
}

int camera_path_known(const args *a, sf_context *ctx, sf_model *model, sf_scene *scene, sf_camera **cameras,
                      size_t *count) {
    double origin[3];
    const char *named = args_value(a, "cameras");
    *cameras = NULL;
    *count = 0;
    if (scene) return scene_cameras(a, ctx, scene, cameras, count);
    char *beside = named ? NULL : app_find_cameras_beside(a->positional[0]);
    const char *path = named ? named : beside;
    sf_camera *read = NULL;
    int error = path && sf_cameras_load(ctx, path, &read, count, origin) ? app_fail(a, ctx) : 0;
    if (!error && read && meet(ctx, model, origin, read, *count)) error = app_fail(a, ctx);
    free(beside);
    if (error || !read) {
        sf_cameras_free(ctx, &read);
        return error;
    }
    *cameras = malloc(*count * sizeof **cameras);
    if (*cameras)
        memcpy(*cameras, read, *count * sizeof **cameras);
    else
        error = app_say(a, "cameras", "out of memory");
    sf_cameras_free(ctx, &read);
    return error;
}

/* ---- Through cameras ---- */

typedef struct key {
    double center[3], quat[4]; /* camera to world */
} key;

static void key_of(const sf_camera *c, key *k) {
    double R[9];
    for (int i = 0; i < 9; i++) R[i] = c->R_cw[3 * (i % 3) + i / 3];
    sf_camera_center(c, k->center);
    sf_rotation_to_quat(R, k->quat);
}

/* Of both quaternions of a rotation, that on the side of the one before. */
static void go_on_from(const key *before, key *k) {
    double sum = 0;
    for (int i = 0; i < 4; i++) sum += before->quat[i] * k->quat[i];
    for (int i = 0; i < 4 && sum < 0; i++) k->quat[i] = -k->quat[i];
}

/* Catmull and Rom's spline: through b at t = 0 and c at 1, with slopes that go on. */
static double spline(double a, double b, double c, double d, double t) {
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

static void pose_of(const double center[3], const double quat[4], const sf_camera *lens, sf_camera *c) {
    double R_wc[9], R[9], t[3];
    sf_rotation_from_quat(quat, R_wc);
    for (int i = 0; i < 9; i++) R[i] = R_wc[3 * (i % 3) + i / 3];
    for (int i = 0; i < 3; i++)
        t[i] = -(R[3 * i] * center[0] + R[3 * i + 1] * center[1] + R[3 * i + 2] * center[2]);
    place(lens, R, t, c);
}

static void between_keys(const key *keys, size_t count, double at, const sf_camera *lens, sf_camera *c) {
    size_t i = at < (double)(count - 1) ? (size_t)at : count - 2;
    const key *k[4] = {&keys[i ? i - 1 : 0], &keys[i], &keys[i + 1], &keys[i + 2 < count ? i + 2 : i + 1]};
    double t = at - (double)i, center[3], quat[4];
    for (int n = 0; n < 3; n++)
        center[n] = spline(k[0]->center[n], k[1]->center[n], k[2]->center[n], k[3]->center[n], t);
    for (int n = 0; n < 4; n++)
        quat[n] = spline(k[0]->quat[n], k[1]->quat[n], k[2]->quat[n], k[3]->quat[n], t);
    pose_of(center, quat, lens, c);
}

static int through_cameras(const args *a, const sf_camera *known, size_t count, const sf_camera *lens,
                           int frames, camera_path *s) {
    int wanted = KEYFRAMES;
    int error = args_int(a, "keyframes", 2, 10000, &wanted);
    if (error) return error;
    if (count < 2) return app_say(a, "--path cameras", "needs a PROJECT of two views or more");
    size_t n = count < (size_t)wanted ? count : (size_t)wanted;
    key *keys = malloc(n * sizeof *keys);
    if (!keys) return app_say(a, "--keyframes", "out of memory");
    for (size_t i = 0; i < n; i++) {
        key_of(&known[i * (count - 1) / (n - 1)], &keys[i]);
        if (i) go_on_from(&keys[i - 1], &keys[i]);
    }
    size_t total = frames ? (size_t)frames : (size_t)((double)(n - 1) * s->rate) + 1;
    error = make_room(a, s, total);
    for (size_t i = 0; i < s->count; i++)
        between_keys(keys, n, total > 1 ? (double)i / (double)(total - 1) * (double)(n - 1) : 0, lens,
                     &s->cameras[i]);
    free(keys);
    return error;
}

/* ---- As a file says ---- */

static int along_path(const args *a, sf_context *ctx, sf_path *path, const sf_camera *lens, int frames,
                      const double origin[3], camera_path *s) {
    static const double world[3] = {0, 0, 0};
    sf_path_info info;
    sf_path_describe(path, &info);
    double seconds = (double)(info.last_ns - info.first_ns) * 1e-9,
           total = floor(seconds * s->rate + 1e-6) + 1;
    if (!frames && total > MOST_FRAMES)
        return app_say(a, info.name, "lasts for more than a million pictures: say --frames or --fps");
    int error = make_room(a, s, frames ? (size_t)frames : (size_t)total);
    for (size_t i = 0; i < s->count && !error; i++) {
        double R[9], t[3], part = frames > 1 ? (double)i / (double)(frames - 1) : 0;
        int64_t at = frames ? llround(part * (double)(info.last_ns - info.first_ns))
                            : llround((double)i / s->rate * 1e9);
        if (at > info.last_ns - info.first_ns) at = info.last_ns - info.first_ns;
        if (sf_path_at(path, info.first_ns + at, R, t)) error = app_fail(a, ctx);
        if (!error) place(lens, R, t, &s->cameras[i]);
        if (!error) camera_path_change_origin(&s->cameras[i], world, origin);
    }
    return error;
}

/* However far apart its poses are, between two of them it goes evenly. */
static int as_file(const args *a, sf_context *ctx, const char *name, const sf_camera *lens, int frames,
                   const sf_model *model, camera_path *s) {
    double origin[3];
    sf_path *path = NULL;
    int whole = !strncmp(name, "file:", 5);
    size_t room = strlen(name) + 32;
    char *full = malloc(room);
    if (!full) return app_say(a, "--path", "out of memory");
    snprintf(full, room, whole ? "%s" : "file:%s?gap=3600", name);
    int error = sf_path_open(ctx, full, &path) ? app_fail(a, ctx) : 0;
    free(full);
    sf_model_get_origin(model, origin);
    if (!error) error = along_path(a, ctx, path, lens, frames, origin, s);
    sf_path_close(&path);
    return error;
}

/* ---- All ---- */

static int make(const args *a, sf_context *ctx, sf_model *model, sf_scene *scene, int frames,
                camera_path *s) {
    const char *name = args_value(a, "path");
    int orbits = !strcmp(name, "orbit"), through = !strcmp(name, "cameras");
    sf_camera lens, *known = NULL;
    size_t count = 0;
    int error = read_lens(a, scene, &lens);
    if (!error && !orbits && !through) return as_file(a, ctx, name, &lens, frames, model, s);
    if (!error) error = camera_path_known(a, ctx, model, scene, &known, &count);
    if (!error && orbits) {
        error = make_room(a, s, frames ? (size_t)frames : ORBIT_FRAMES);
        for (size_t i = 0; i < s->count; i++) s->cameras[i] = lens;
        if (!error) error = camera_path_orbit(a, ctx, model, known, count, s);
    } else if (!error) {
        error = through_cameras(a, known, count, &lens, frames, s);
    }
    free(known);
    return error;
}

int camera_path_make(const args *a, sf_context *ctx, sf_model *model, sf_scene *scene, camera_path *s) {
    int frames = 0, rate = 30;
    *s = (camera_path){0};
    int error = args_int(a, "frames", 1, MOST_FRAMES, &frames);
    if (!error) error = args_int(a, "fps", 1, 1000, &rate);
    s->rate = rate;
    return error ? error : make(a, ctx, model, scene, frames, s);
}

char *camera_path_lines(const camera_path *s, const sf_model *model) {
    double origin[3];
    sf_model_get_origin(model, origin);
    char *text = malloc(APP_POSE_LINE * (s->count + 1));
    size_t n = text ? app_pose_header(text) : 0;
    for (size_t i = 0; i < s->count && text; i++) {
        key k;
        key_of(&s->cameras[i], &k);
        for (int axis = 0; axis < 3; axis++) k.center[axis] += origin[axis];
        n += app_pose_line(text + n, (double)i / s->rate, k.center, k.quat);
    }
    return text;
}
