/* opensfm.c - see opensfm.h.
 *
 * Its focal lengths and principal points count in the longer side of the picture, from the picture's middle.
 * A shot has a rotation vector and a translation from the world to the camera, whose axes are ours.
 */
#include "opensfm.h"

#include "../base/file.h"
#include "json_read.h"
#include "paths.h"

#include <ctype.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const uint64_t MAX_FILE_BYTES = 1 << 28; /* as JSON a hundred times that at most */

typedef struct reader {
    sf_context *ctx;
    sf_project *project;
    const char *file;
    char *pictures; /* folder */
    const json_t *cameras;
} reader;

/* A place in the file, for messages. */
typedef struct spot {
    const reader *r;
    const char *kind, *name; /* shots, a.jpg */
    const json_t *json;
} spot;

static sf_status spot_fail(const spot *s, const char *key, const char *fault) {
    return sf_fail(s->r->ctx, SF_ERR_FORMAT, "%s: %s[\"%s\"]: %s: %s", s->r->file, s->kind, s->name, key,
                   fault);
}

/* *value stays as it is where the key is missing. */
static sf_status get_number(const spot *s, const char *key, double *value) {
    const json_t *number = json_object_get(s->json, key);
    if (!number) return SF_OK;
    if (!json_is_number(number)) return spot_fail(s, key, "is not a number");
    *value = json_number_value(number);
    return SF_OK;
}

static sf_status get_three(const spot *s, const char *key, double value[3]) {
    const json_t *array = json_object_get(s->json, key);
    if (json_array_size(array) != 3) return spot_fail(s, key, array ? "is not 3 numbers" : "is missing");
    for (size_t i = 0; i < 3; i++) {
        const json_t *number = json_array_get(array, i);
        if (!json_is_number(number)) return spot_fail(s, key, "is not 3 numbers");
        value[i] = json_number_value(number);
    }
    return SF_OK;
}

static sf_status get_side(const spot *s, const char *key, int *side) {
    double value = 0;
    sf_status status = get_number(s, key, &value);
    if (status) return status;
    if (!(value >= 1 && value <= SF_PICTURE_MAX_SIDE && value == floor(value)))
        return spot_fail(s, key, json_object_get(s->json, key) ? "is not a picture's side" : "is missing");
    *side = (int)value;
    return SF_OK;
}

/* Cameras. */

static const struct projection {
    const char *name, *layout; /* the terms that it has, as sf_lens_model's; k1 to k4 and p1, p2 by name */
    sf_projection projection;
} projections[] = {
    {"perspective", "12", SF_PERSPECTIVE}, {"simple_radial", "1", SF_PERSPECTIVE},
    {"radial", "12", SF_PERSPECTIVE},      {"brown", "123ab", SF_PERSPECTIVE},
    {"fisheye", "12", SF_EQUIDISTANT},     {"fisheye_opencv", "1234", SF_EQUIDISTANT},
};

enum { PROJECTIONS = sizeof projections / sizeof *projections };

static sf_status find_projection(const spot *camera, const struct projection **projection) {
    const json_t *type = json_object_get(camera->json, "projection_type");
    const char *name = type ? json_string_value(type) : projections[0].name;
    if (!name) return spot_fail(camera, "projection_type", "is not a text");
    for (size_t i = 0; i < PROJECTIONS; i++)
        if (!strcmp(name, projections[i].name)) {
            *projection = &projections[i];
            return SF_OK;
        }
    return sf_fail(camera->r->ctx, SF_ERR_UNSUPPORTED,
                   "%s: cameras[\"%s\"]: projection_type: %s is not supported", camera->r->file, camera->name,
                   name);
}

static sf_status find_terms(const spot *camera, const char *layout, sf_optics *o) {
    sf_status status = SF_OK;
    for (const char *c = layout; !status && *c; c++) {
        char key[3] = {*c < 'a' ? 'k' : 'p', *c < 'a' ? *c : (char)(*c - 'a' + '1'), 0};
        status = get_number(camera, key, sf_optics_value(o, *c));
    }
    return status;
}

/* Older files have one focal length, and no principal point. */
static sf_status find_middle(const spot *camera, sf_entry *e) {
    double longer = e->width > e->height ? e->width : e->height;
    double focal = NAN, focal_x, focal_y, x = 0, y = 0;
    sf_status status = get_number(camera, "focal", &focal);
    focal_x = focal_y = focal;
    if (!status) status = get_number(camera, "focal_x", &focal_x);
    if (isnan(focal_y)) focal_y = focal_x;
    if (!status) status = get_number(camera, "focal_y", &focal_y);
    if (!status) status = get_number(camera, "c_x", &x);
    if (!status) status = get_number(camera, "c_y", &y);
    if (!status && isnan(focal_x)) status = spot_fail(camera, "focal", "is missing");
    e->lens.fx = focal_x * longer;
    e->lens.fy = focal_y * longer;
    e->lens.cx = e->width / 2.0 + x * longer;
    e->lens.cy = e->height / 2.0 + y * longer;
    return status;
}

static sf_status find_lens(const spot *shot, sf_entry *e) {
    const char *name = json_string_value(json_object_get(shot->json, "camera"));
    if (!name) return spot_fail(shot, "camera", "is missing, or not a text");
    spot camera = {shot->r, "cameras", name, json_object_get(shot->r->cameras, name)};
    if (!json_is_object(camera.json)) return spot_fail(shot, "camera", "there is no camera of that name");
    const struct projection *p = NULL;
    sf_status status = find_projection(&camera, &p);
    if (status) return status;
    e->lens = (sf_optics){.model = p->name, .projection = p->projection};
    status = get_side(&camera, "width", &e->width);
    if (!status) status = get_side(&camera, "height", &e->height);
    if (!status) status = find_middle(&camera, e);
    return status ? status : find_terms(&camera, p->layout, &e->lens);
}

/* Shots. */

/* The rotation about v by its length, in radians. */
static void rotate_about(const double v[3], double R[9]) {
    double angle = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    double a = angle > 1e-12 ? sin(angle) / angle : 1;
    double b = angle > 1e-6 ? (1 - cos(angle)) / (angle * angle) : 0.5, c = cos(angle);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = b * v[i] * v[j] + (i == j ? c : 0);
    R[1] -= a * v[2];
    R[2] += a * v[1];
    R[3] += a * v[2];
    R[5] -= a * v[0];
    R[6] -= a * v[1];
    R[7] += a * v[0];
}

static sf_status find_pose(const spot *shot, sf_entry *e) {
    double v[3];
    sf_status status = get_three(shot, "rotation", v);
    if (!status) status = get_three(shot, "translation", e->t_cw);
    if (status) return status;
    rotate_about(v, e->R_cw);
    for (int i = 0; i < 3; i++) e->bad_pose |= !isfinite(v[i]) || !isfinite(e->t_cw[i]);
    return SF_OK;
}

static sf_status read_shot(reader *r, const char *name, const json_t *json) {
    /* Undistorted pictures may have an ending more than their shots. */
    static const char *const endings[] = {"", ".jpg", ".png", ".JPG", ".PNG", NULL};
    spot shot = {r, "shots", name, json};
    sf_entry *e;
    sf_status status = sf_project_add(r->project, r->file, r->pictures, name, &e);
    if (!status) status = sf_entry_complete(r->ctx, e, endings);
    if (!status) status = find_pose(&shot, e);
    return status ? status : find_lens(&shot, e);
}

/* Points. */

static sf_status read_point(reader *r, const char *name, const json_t *json) {
    spot point = {r, "points", name, json};
    double xyz[3], rgb[3] = {128, 128, 128};
    sf_status status = get_three(&point, "coordinates", xyz);
    if (!status && json_object_get(json, "color")) status = get_three(&point, "color", rgb);
    if (status) return status;
    size_t at = 3 * r->project->points++;
    for (size_t k = 0; k < 3; k++) {
        r->project->xyz[at + k] = xyz[k];
        r->project->rgb[at + k] = (uint8_t)lround(fmin(fmax(rgb[k], 0), 255));
    }
    return SF_OK;
}

static sf_status read_points(reader *r, json_t *points) {
    size_t count = json_object_size(points);
    if (!count) return SF_OK;
    r->project->xyz = sf_alloc(r->ctx, count, 3 * sizeof *r->project->xyz);
    r->project->rgb = sf_alloc(r->ctx, count, 3);
    if (!r->project->xyz || !r->project->rgb) return SF_ERR_MEMORY;
    const char *name;
    json_t *point;
    sf_status status = SF_OK;
    json_object_foreach(points, name, point) {
        if (!status) status = read_point(r, name, point);
    }
    return status;
}

/* The whole. */

static sf_status read_reconstruction(reader *r, const json_t *json) {
    json_t *shots = json_object_get(json, "shots"), *shot;
    const char *name;
    r->cameras = json_object_get(json, "cameras");
    if (!json_is_object(r->cameras) || !json_is_object(shots))
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: is missing, or not an object", r->file,
                       json_is_object(r->cameras) ? "shots" : "cameras");
    sf_status status = SF_OK;
    json_object_foreach(shots, name, shot) {
        if (!status) status = read_shot(r, name, shot);
    }
    return status ? status : read_points(r, json_object_get(json, "points"));
}

static sf_status choose(const reader *r, const json_t *root, int wanted, const json_t **chosen) {
    size_t count = json_array_size(root), best = 0, most = 0;
    if (!count)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: JSON: the top level is not an array of reconstructions",
                       r->file);
    if (wanted >= 0 && (size_t)wanted >= count)
        return sf_fail(r->ctx, SF_ERR_IO, "%s: sub_model: none of its %zu reconstructions is %d", r->file,
                       count, wanted);
    for (size_t i = 0; i < count; i++) {
        size_t shots = json_object_size(json_object_get(json_array_get(root, i), "shots"));
        if (shots <= most) continue;
        most = shots;
        best = i;
    }
    if (wanted >= 0)
        best = (size_t)wanted;
    else if (count > 1)
        sf_log(r->ctx, SF_LOG_INFO, "%s: of %zu reconstructions, %zu is taken: it has most shots, %zu",
               r->file, count, best, most);
    *chosen = json_array_get(root, best);
    return SF_OK;
}

/* images/ beside the file, else beside its folder, as OpenDroneMap has it. */
static sf_status find_pictures(reader *r, const char *folder, const char *wanted) {
    static const char *const above[] = {"", "../"};
    const char *name = wanted ? wanted : "images";
    for (int i = 0; i < 2; i++) {
        size_t size = strlen(folder) + strlen(name) + 5;
        r->pictures = sf_alloc(r->ctx, size, 1);
        if (!r->pictures) return SF_ERR_MEMORY;
        snprintf(r->pictures, size, "%s/%s%s", folder, above[i], name);
        if (sf_is_folder(r->pictures)) return SF_OK;
        sf_status status = sf_check_link(r->ctx, r->pictures);
        sf_free(r->ctx, r->pictures);
        r->pictures = NULL;
        if (status) return status;
    }
    return sf_fail(r->ctx, SF_ERR_IO, "%s/%s: no such folder of pictures", folder, name);
}

static sf_status read_file(reader *r, const char *folder, const sf_load_options *options) {
    json_t *root;
    const json_t *chosen = NULL;
    sf_status status = sf_json_read(r->ctx, r->file, MAX_FILE_BYTES, &root);
    if (!status) status = choose(r, root, options->sub_model, &chosen);
    if (!status) status = find_pictures(r, folder, options->images);
    if (!status) status = read_reconstruction(r, chosen);
    json_decref(root);
    return status;
}

int sf_opensfm_is(const char *file) {
    uint8_t start[256];
    size_t size = sf_read_start(file, start, sizeof start), at = sf_text_mark(start, size);
    while (at < size && isspace(start[at])) at++;
    return at < size && start[at] == '[';
}

sf_status sf_opensfm_read(sf_project *project, const char *file, const sf_load_options *options) {
    reader r = {.ctx = project->ctx, .project = project, .file = file};
    project->kind = "OpenSfM";
    char *folder = sf_path_folder(r.ctx, file);
    sf_status status = folder ? sf_project_set_folder(project, folder) : SF_ERR_MEMORY;
    if (!status) status = read_file(&r, folder, options);
    sf_free(r.ctx, r.pictures);
    sf_free(r.ctx, folder);
    return status;
}
