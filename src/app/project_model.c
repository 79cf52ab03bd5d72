/* project_model.c - a project to look at: its points and cameras as Gaussians. */
#include <math.h>
#include <stdlib.h>

#include "app.h"

/* In parts of the scene's size. */
#define POINT 0.0015 /* deviation of a point */
#define LINE  0.0012 /* deviation across a camera's lines */
#define DEPTH 0.08   /* from a camera's centre to the frame of its picture */

/* A camera is drawn as the four edges of a pyramid, the frame of its picture, and a roof over the frame's
 * top, each a row of Gaussians. */
enum { CORNERS = 4, LINES = 10, PIECES = 6, EACH = LINES * PIECES };

static const float red_green_blue[2][3] = {{1.0f, 0.6f, 0.1f}, {0.2f, 0.8f, 1.0f}}; /* by sf_split */

typedef struct drawing {
    sf_gaussians g; /* degree 0 */
    size_t count;
    double size; /* of the scene, world units */
} drawing;

static void add(drawing *d, const double at[3], const double quat[4], const double scales[3],
                const float color[3]) {
    size_t i = d->count++;
    for (size_t k = 0; k < 3; k++) {
        d->g.means[3 * i + k] = (float)at[k];
        d->g.log_scales[3 * i + k] = (float)log(scales[k]);
        d->g.sh[3 * i + k] = (color[k] - 0.5f) / 0.28209479f; /* Y_00 */
    }
    for (size_t k = 0; k < 4; k++) d->g.quats[4 * i + k] = (float)quat[k];
    d->g.logit_opacities[i] = 3;
}

/* The rotation that takes the x axis to the direction of `along`, of any length above 0. */
static void turn_x_to(const double along[3], double quat[4]) {
    double length = sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);
    double x = along[0] / length;
    quat[0] = 1 + x, quat[1] = 0, quat[2] = -along[2] / length, quat[3] = along[1] / length;
    if (quat[0] < 1e-6) quat[0] = quat[2] = 0, quat[3] = 1; /* half a turn about z */
}

static void add_line(drawing *d, const double from[3], const double to[3], const float color[3]) {
    double along[3], length = 0, quat[4], at[3];
    for (int k = 0; k < 3; k++) along[k] = to[k] - from[k], length += along[k] * along[k];
    length = sqrt(length);
    const double scales[3] = {0.5 * length / PIECES, LINE * d->size, LINE * d->size};
    turn_x_to(along, quat);
    for (int i = 0; i < PIECES; i++) {
        for (int k = 0; k < 3; k++) at[k] = from[k] + along[k] * (i + 0.5) / PIECES;
        add(d, at, quat, scales, color);
    }
}

/* The place in the world that pixel x, y shows at a depth. */
static void place(const sf_camera *c, double x, double y, double depth, double at[3]) {
    double center[3];
    const double ray[3] = {(x - c->cx) / c->fx * depth, (y - c->cy) / c->fy * depth, depth};
    sf_camera_center(c, center);
    for (int k = 0; k < 3; k++)
        at[k] = center[k] + c->R_cw[k] * ray[0] + c->R_cw[3 + k] * ray[1] + c->R_cw[6 + k] * ray[2];
}

static void add_camera(drawing *d, const sf_view_info *view) {
    const sf_camera *c = &view->camera;
    const float *color = red_green_blue[view->split == SF_SPLIT_TEST];
    const double w = c->width, h = c->height, pixels[CORNERS][2] = {{0, 0}, {w, 0}, {w, h}, {0, h}};
    double center[3], roof[3], corners[CORNERS][3];
    sf_camera_center(c, center);
    place(c, w / 2, -0.25 * h, DEPTH * d->size, roof);
    for (int i = 0; i < CORNERS; i++) place(c, pixels[i][0], pixels[i][1], DEPTH * d->size, corners[i]);
    for (int i = 0; i < CORNERS; i++) {
        add_line(d, center, corners[i], color);
        add_line(d, corners[i], corners[(i + 1) % CORNERS], color);
    }
    add_line(d, corners[0], roof, color);
    add_line(d, corners[1], roof, color);
}

static void add_points(drawing *d, const float *xyz, const uint8_t *rgb, size_t count) {
    const double quat[4] = {1, 0, 0, 0}, scales[3] = {POINT * d->size, POINT * d->size, POINT * d->size};
    for (size_t i = 0; i < count; i++) {
        const double at[3] = {(double)xyz[3 * i], (double)xyz[3 * i + 1], (double)xyz[3 * i + 2]};
        const float color[3] = {(float)rgb[3 * i] / 255, (float)rgb[3 * i + 1] / 255,
                                (float)rgb[3 * i + 2] / 255};
        add(d, at, quat, scales, color);
    }
}

static sf_status draw(sf_context *ctx, sf_scene *scene, const sf_scene_info *info, drawing *d,
                      sf_model **model) {
    float *xyz = malloc((info->points + 1) * 3 * sizeof *xyz);
    uint8_t *rgb = malloc((info->points + 1) * 3);
    sf_status status = xyz && rgb ? SF_OK : SF_ERR_MEMORY;
    sf_view_info view;
    if (!status) add_points(d, xyz, rgb, sf_scene_get_points(scene, 0, info->points, xyz, rgb));
    for (size_t i = 0; i < info->views && !status; i++) {
        status = sf_scene_get_view(scene, i, &view);
        if (!status) add_camera(d, &view);
    }
    free(xyz);
    free(rgb);
    if (!status) status = sf_model_create(ctx, d->count, 0, model);
    if (!status) status = sf_model_set(*model, 0, d->count, &d->g);
    if (!status) sf_scene_place_model(scene, *model);
    return status;
}

int app_project_model(const args *a, sf_context *ctx, sf_scene *scene, sf_model **model) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    size_t n = info.points + EACH * info.views + 1;
    drawing d = {.g = {.means = malloc(n * 3 * sizeof(float)),
                       .quats = malloc(n * 4 * sizeof(float)),
                       .log_scales = malloc(n * 3 * sizeof(float)),
                       .logit_opacities = malloc(n * sizeof(float)),
                       .sh = malloc(n * 3 * sizeof(float))},
                 .size = info.extent};
    int room = d.g.means && d.g.quats && d.g.log_scales && d.g.logit_opacities && d.g.sh;
    int error = !room                                ? app_say(a, a->positional[0], "out of memory")
                : draw(ctx, scene, &info, &d, model) ? app_fail(a, ctx)
                                                     : 0;
    free(d.g.means);
    free(d.g.quats);
    free(d.g.log_scales);
    free(d.g.logit_opacities);
    free(d.g.sh);
    return error;
}
