/* transforms.c - see transforms.h. */
#include "transforms.h"

#include "../base/linear.h"
#include "frame_pictures.h"
#include "json_read.h"
#include "ply.h"
#include "paths.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum {
    WHERE_BYTES = 64, /* "frames[18446744073709551615]: " */
    POLISH_STEPS = 6, /* of a rotation within 1e-2: each squares the error */
};

static const uint64_t MAX_FILE_BYTES = 1 << 26; /* as JSON a hundred times that at most */
static const double ROTATION_TOLERANCE = 1e-2, LAST_ROW_TOLERANCE = 1e-6;

typedef struct reader {
    sf_context *ctx;
    sf_project *project;
    const char *file;
    const sf_load_options *options;
    char *folder;       /* of the file: its paths start there */
    const char *images; /* in place of the images/ of names; NULL: images/ */
    size_t named;       /* names that begin with images/ */
    const json_t *root;
    sf_split split; /* of the frames, unless the file lists names */
} reader;

/* One frame; what it does not say, the top level says for all. */
typedef struct frame {
    reader *r;
    const json_t *json; /* NULL: the top level itself */
    size_t index;
} frame;

/* Values. */

static sf_status frame_fail(const frame *f, sf_status status, const char *key, const char *fault) {
    char where[WHERE_BYTES] = "";
    if (f->json) snprintf(where, sizeof where, "frames[%zu]: ", f->index);
    return sf_fail(f->r->ctx, status, "%s: %s%s: %s", f->r->file, where, key, fault);
}

static const json_t *lookup(const frame *f, const char *key) {
    const json_t *value = json_object_get(f->json, key);
    return value ? value : json_object_get(f->r->root, key);
}

/* *value stays as it is where the key is missing. */
static sf_status get_number(const frame *f, const char *key, double *value) {
    const json_t *number = lookup(f, key);
    if (!number) return SF_OK;
    if (!json_is_number(number)) return frame_fail(f, SF_ERR_FORMAT, key, "is not a number");
    *value = json_number_value(number);
    return SF_OK;
}

static sf_status get_text(const frame *f, const char *key, const char **value) {
    const json_t *text = lookup(f, key);
    *value = NULL;
    if (!text) return SF_OK;
    if (!json_is_string(text)) return frame_fail(f, SF_ERR_FORMAT, key, "is not a text");
    *value = json_string_value(text);
    return SF_OK;
}

/* Sides are written as 1920 and as 1920.0; 0 where the key is missing. */
static sf_status get_side(const frame *f, const char *key, int *side) {
    double value = 0;
    sf_status status = get_number(f, key, &value);
    if (status) return status;
    if (lookup(f, key) && !(value >= 1 && value <= SF_PICTURE_MAX_SIDE && value == floor(value)))
        return sf_fail(f->r->ctx, SF_ERR_FORMAT, "%s: frames[%zu]: %s: %g is not a whole number in 1..%d",
                       f->r->file, f->index, key, value, SF_PICTURE_MAX_SIDE);
    *side = (int)value;
    return SF_OK;
}

/* Lens. */

/* The model that a file names, or that its flags mean; where it says nothing, what all terms describe. */
static sf_status find_model(const frame *f, const sf_lens_model **model) {
    static const char *const flags[] = {"latlong", "equirectangular", "orthographic"};
    const char *name;
    sf_status status = get_text(f, "camera_model", &name);
    for (int i = 0; !status && i < 3; i++) /* instant-ngp's, which has no camera_model */
        if (lookup(f, flags[i]) && !json_is_false(lookup(f, flags[i])))
            status = frame_fail(f, SF_ERR_UNSUPPORTED, flags[i], "such pictures are not supported");
    if (status) return status;
    const json_t *fisheye = lookup(f, "is_fisheye");
    if (fisheye && !json_is_boolean(fisheye))
        return frame_fail(f, SF_ERR_FORMAT, "is_fisheye", "is not true or false");
    if (json_is_true(fisheye)) name = "OPENCV_FISHEYE";
    if (lookup(f, "ftheta_p0")) name = "FTHETA";
    *model = sf_lens_model_named(name ? name : "OPENCV");
    if (*model && (*model)->layout && (*model)->projection != SF_FIELD_OF_VIEW) return SF_OK;
    return sf_fail(f->r->ctx, SF_ERR_UNSUPPORTED, "%s: frames[%zu]: camera_model: %s is not supported",
                   f->r->file, f->index, name);
}

static int is_rational(const sf_lens_model *model) { return strchr(model->layout, '5') != NULL; }

/* Terms that are there count whatever the model's name; a rational one shares k4 out otherwise. */
static sf_status find_terms(const frame *f, const sf_lens_model *model, sf_optics *o) {
    static const struct {
        char letter, rational;
        const char *key;
    } terms[] = {{'1', '1', "k1"}, {'2', '2', "k2"}, {'3', '3', "k3"}, {'4', '5', "k4"},
                 {0, '6', "k5"},   {0, '7', "k6"},   {'a', 'a', "p1"}, {'b', 'b', "p2"}};
    for (size_t i = 0; i < sizeof terms / sizeof *terms; i++) {
        double other = 0;
        char letter = is_rational(model) ? terms[i].rational : terms[i].letter;
        sf_status status = get_number(f, terms[i].key, letter ? sf_optics_value(o, letter) : &other);
        if (!status && other != 0)
            return sf_fail(f->r->ctx, SF_ERR_UNSUPPORTED,
                           "%s: frames[%zu]: %s: %g is not supported, only 0, but for FULL_OPENCV",
                           f->r->file, f->index, terms[i].key, other);
        if (status) return status;
    }
    return SF_OK;
}

/* Of all that are in px. */
static int says_lengths(const frame *f) {
    static const char *const keys[] = {"fl_x", "fl_y", "cx", "cy"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (lookup(f, keys[i])) return 1;
    return 0;
}

/* From the file, otherwise the picture's own: not that of a smaller copy, where the lens is in px. A picture
 * that cannot be read leaves 0: its view is skipped later. */
static sf_status find_picture(const frame *f, sf_entry *e) {
    reader *r = f->r;
    int named;
    sf_status status = get_side(f, "w", &e->width);
    if (!status) status = get_side(f, "h", &e->height);
    if (status) return status;
    if (!e->width != !e->height) return frame_fail(f, SF_ERR_FORMAT, e->width ? "h" : "w", "is missing");
    status = sf_frame_find_picture(r->ctx, r->folder, r->images, e, &named);
    r->named += named != 0;
    if (status || e->width || !r->images || !named) return status;
    if (says_lengths(f))
        return frame_fail(f, SF_ERR_FORMAT, "w",
                          "is missing, and so is the picture in images/: the lens is given in its pixels");
    return sf_picture_size(r->ctx, e->path, &e->width, &e->height) == SF_ERR_MEMORY ? SF_ERR_MEMORY : SF_OK;
}

static double focal(double side, double angle) { return side / 2 / tan(angle / 2); }

/* Along one axis, px, of what the top level or a frame says itself: the first of `keys` counts, which are an
 * angle in degrees, a length and an angle in radians. *value stays as it is where none is there. */
static sf_status level_focal(const frame *f, const json_t *level, const char *const keys[3], int side,
                             double *value) {
    const double degree = acos(-1) / 180;
    for (int i = 0; i < 3; i++) {
        const json_t *number = json_object_get(level, keys[i]);
        if (!number) continue;
        if (!json_is_number(number)) return frame_fail(f, SF_ERR_FORMAT, keys[i], "is not a number");
        double said = json_number_value(number);
        *value = i == 1 ? said : focal(side, i ? said : said * degree);
        break;
    }
    return SF_OK;
}

/* What a frame says goes before what the file says, and one axis stands for both where the other is missing:
 * instant-ngp's order. */
static sf_status find_focal(const frame *f, sf_entry *e) {
    static const char *const x_keys[] = {"x_fov", "fl_x", "camera_angle_x"};
    static const char *const y_keys[] = {"y_fov", "fl_y", "camera_angle_y"};
    const json_t *levels[] = {f->r->root, f->json};
    sf_optics *lens = &e->lens;
    int found = 0;
    for (int i = 0; i < 2; i++) {
        double x = -INFINITY, y = -INFINITY; /* not said */
        sf_status status = level_focal(f, levels[i], x_keys, e->width, &x);
        if (!status) status = level_focal(f, levels[i], y_keys, e->height, &y);
        if (status) return status;
        if (x == -INFINITY && y == -INFINITY) continue;
        lens->fx = x == -INFINITY ? y : x;
        lens->fy = y == -INFINITY ? x : y;
        found = 1;
    }
    return found ? SF_OK : frame_fail(f, SF_ERR_FORMAT, "fl_x", "is missing");
}

static sf_status find_lens(const frame *f, sf_entry *e) {
    const sf_lens_model *model = NULL;
    sf_status status = find_model(f, &model);
    if (status) return status;
    e->lens = (sf_optics){
        .model = model->name, .projection = model->projection, .cx = e->width / 2.0, .cy = e->height / 2.0};
    status = find_focal(f, e);
    if (!status) status = get_number(f, "cx", &e->lens.cx);
    if (!status) status = get_number(f, "cy", &e->lens.cy);
    if (!status) status = find_terms(f, model, &e->lens);
    if (!lookup(f, "camera_model") && !sf_optics_is_distorted(&e->lens)) e->lens.model = "PINHOLE";
    return status;
}

/* Pose. */

/* The transpose of the inverse; NaN for a singular matrix. */
static void cofactors_over_det(const double M[9], double out[9]) {
    double C[9] = {M[4] * M[8] - M[5] * M[7], M[5] * M[6] - M[3] * M[8], M[3] * M[7] - M[4] * M[6],
                   M[2] * M[7] - M[1] * M[8], M[0] * M[8] - M[2] * M[6], M[1] * M[6] - M[0] * M[7],
                   M[1] * M[5] - M[2] * M[4], M[2] * M[3] - M[0] * M[5], M[0] * M[4] - M[1] * M[3]};
    double det = M[0] * C[0] + M[1] * C[1] + M[2] * C[2];
    for (int i = 0; i < 9; i++) out[i] = C[i] / (det > 0 ? det : NAN); /* a mirror is no rotation */
}

/* Divides out a uniform scale and takes the nearest rotation; 0 where none is near. */
static int make_rotation(double M[9]) {
    double squares = 0, inverse[9];
    for (int i = 0; i < 9; i++) squares += M[i] * M[i];
    double scale = sqrt(squares / 3);
    for (int i = 0; i < 9; i++) M[i] /= scale;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = 0;
            for (int k = 0; k < 3; k++) dot += M[3 * i + k] * M[3 * j + k];
            if (!(fabs(dot - (i == j)) <= ROTATION_TOLERANCE)) return 0;
        }
    for (int step = 0; step < POLISH_STEPS; step++) {
        cofactors_over_det(M, inverse);
        for (int i = 0; i < 9; i++) M[i] = (M[i] + inverse[i]) / 2; /* Newton's step to the polar factor */
    }
    return isfinite(M[0]);
}

/* Camera to world with OpenGL's axes (+y up, +z back) to ours; *bad where it is no pose. */
static void read_pose(const double c2w[16], double R[9], double center[3], int *bad) {
    for (int row = 0; row < 3; row++)
        for (int k = 0; k < 3; k++) R[3 * row + k] = (row ? -1 : 1) * c2w[4 * k + row];
    double last_row = fabs(c2w[12]) + fabs(c2w[13]) + fabs(c2w[14]) + fabs(c2w[15] - 1);
    if (!make_rotation(R) || !(last_row <= LAST_ROW_TOLERANCE)) *bad = 1;
    for (int row = 0; row < 3; row++) center[row] = c2w[4 * row + 3];
}

/* From the pose R, center to R_to, to, both rotation and centre evenly in time. */
static void move_pose(double time, const double R_to[9], const double to[3], double R[9], double center[3]) {
    double back[9], way[9], phi[3], from[9];
    memcpy(from, R, sizeof from);
    for (int i = 0; i < 9; i++) back[i] = from[3 * (i % 3) + i / 3];
    sf_mat3_mul(R_to, back, way);
    sf_rotation_log(way, phi);
    for (int k = 0; k < 3; k++) phi[k] *= time;
    sf_rotation_exp(phi, way);
    sf_mat3_mul(way, from, R);
    for (int k = 0; k < 3; k++) center[k] += time * (to[k] - center[k]);
}

/* The pose between start and end at that time; at 0 it is the start to the last bit. */
static void set_pose(const double start[16], const double end[16], double time, sf_entry *e) {
    double *R = e->R_cw, center[3], R_end[9], center_end[3];
    e->bad_pose = 0;
    read_pose(start, R, center, &e->bad_pose);
    if (time != 0) {
        read_pose(end, R_end, center_end, &e->bad_pose);
        move_pose(time, R_end, center_end, R, center);
    }
    for (int row = 0; row < 3; row++) {
        e->t_cw[row] = -sf_dot3(R + 3 * row, center);
        if (!isfinite(e->t_cw[row])) e->bad_pose = 1;
    }
}

void sf_entry_set_opengl_pose(sf_entry *e, const double c2w[16]) { set_pose(c2w, c2w, 0, e); }

static sf_status read_matrix(const frame *f, const char *key, double c2w[16]) {
    const json_t *matrix = json_object_get(f->json, key);
    if (!matrix) return frame_fail(f, SF_ERR_FORMAT, key, "is missing");
    size_t rows = json_array_size(matrix);
    if (rows != 3 && rows != 4) return frame_fail(f, SF_ERR_FORMAT, key, "has not 3 or 4 rows");
    for (int k = 0; k < 4; k++) c2w[12 + k] = k == 3;
    for (size_t i = 0; i < 4 * rows; i++) {
        const json_t *row = json_array_get(matrix, i / 4), *value = json_array_get(row, i % 4);
        if (json_array_size(row) != 4)
            return frame_fail(f, SF_ERR_FORMAT, key, "has a row that is not 4 numbers");
        if (!json_is_number(value))
            return frame_fail(f, SF_ERR_FORMAT, key, "holds a value that is no number");
        c2w[i] = json_number_value(value);
    }
    return SF_OK;
}

/* [A, B, C, D]: the pixel at u, v (0..1) is exposed at the time A + B u + C v and D more at most, where 0 is
 * the start and 1 is the end. One pose stands only for A. */
static sf_status find_time(const frame *f, double *time) {
    static const char key[] = "rolling_shutter";
    const json_t *shutter = lookup(f, key);
    size_t size = json_array_size(shutter);
    if (!shutter) return SF_OK;
    if (size != 3 && size != 4) return frame_fail(f, SF_ERR_FORMAT, key, "has not 3 or 4 numbers");
    for (size_t i = 0; i < size; i++) {
        const json_t *value = json_array_get(shutter, i);
        if (!json_is_number(value))
            return frame_fail(f, SF_ERR_FORMAT, key, "holds a value that is no number");
        if (i && json_number_value(value) != 0)
            return frame_fail(f, SF_ERR_UNSUPPORTED, key,
                              "a pose that changes within the picture is not supported, only [A, 0, 0, 0]");
    }
    *time = json_number_value(json_array_get(shutter, 0));
    return SF_OK;
}

/* As instant-ngp: the start goes before the one matrix of a camera at rest. */
static sf_status find_pose(const frame *f, sf_entry *e) {
    static const char one[] = "transform_matrix", first[] = "transform_matrix_start",
                      last[] = "transform_matrix_end";
    double start[16] = {0}, end[16], time = 0;
    sf_status status = read_matrix(f, json_object_get(f->json, first) ? first : one, start);
    memcpy(end, start, sizeof end);
    if (!status && json_object_get(f->json, last)) status = read_matrix(f, last, end);
    if (!status && memcmp(start, end, sizeof end)) status = find_time(f, &time);
    if (!status) set_pose(start, end, time, e);
    return status;
}

/* Files. */

/* The path in the file's folder of the name that stands at the key. */
static sf_status find_inside(const frame *f, const char *key, const char *name, char **path) {
    char *plain = sf_plain_name(f->r->ctx, f->r->folder, name);
    if (!plain) return SF_ERR_MEMORY;
    sf_status status = SF_OK;
    if (!sf_name_stays_inside(plain))
        status = frame_fail(f, SF_ERR_FORMAT, key, "is not a path inside the folder");
    else if (!(*path = sf_path_join(f->r->ctx, f->r->folder, plain)))
        status = SF_ERR_MEMORY;
    sf_free(f->r->ctx, plain);
    return status;
}

static sf_status find_mask(const frame *f, sf_entry *e) {
    const char *name;
    sf_status status = get_text(f, "mask_path", &name);
    if (status || !name) return status;
    return find_inside(f, "mask_path", name, &e->mask);
}

static sf_status read_frame(reader *r, size_t index, const json_t *json) {
    frame f = {.r = r, .json = json, .index = index};
    sf_entry *e;
    if (!json_is_object(json))
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: frames[%zu]: is not an object", r->file, index);
    const json_t *name = json_object_get(json, "file_path");
    if (!json_is_string(name))
        return frame_fail(&f, SF_ERR_FORMAT, "file_path", name ? "is not a text" : "is missing");
    sf_status status = sf_project_add(r->project, r->file, r->folder, json_string_value(name), &e);
    if (status) return status;
    e->split = r->split;
    status = find_picture(&f, e);
    if (!status) status = find_pose(&f, e);
    if (!status) status = find_lens(&f, e);
    return status ? status : find_mask(&f, e);
}

static sf_status read_frames(reader *r) {
    const json_t *frames = json_object_get(r->root, "frames");
    if (!json_is_array(frames))
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: frames: %s", r->file,
                       frames ? "is not an array" : "is missing");
    sf_status status = SF_OK;
    for (size_t i = 0; !status && i < json_array_size(frames); i++)
        status = read_frame(r, i, json_array_get(frames, i));
    if (!status && r->options->images && !r->named && json_array_size(frames))
        return sf_fail(r->ctx, SF_ERR_ARGUMENT,
                       "%s: images: %s: no file_path begins with images/, in whose place it would be taken; "
                       "--downscale makes pictures smaller",
                       r->file, r->options->images);
    return status;
}

/* Split and points. */

static sf_status mark(reader *r, const char *key, sf_split split) {
    const json_t *names = json_object_get(r->root, key);
    if (!names) return SF_OK;
    if (!json_is_array(names)) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s: is not an array", r->file, key);
    for (size_t i = 0; i < json_array_size(names); i++) {
        const char *name = json_string_value(json_array_get(names, i));
        if (!name) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s[%zu]: is not a text", r->file, key, i);
        char *plain = sf_plain_name(r->ctx, r->folder, name);
        if (!plain) return SF_ERR_MEMORY;
        sf_entry *e = sf_project_find(r->project, plain);
        sf_free(r->ctx, plain);
        if (!e)
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %s[%zu]: no frame has '%s'", r->file, key, i, name);
        e->split = split;
    }
    r->project->has_split = 1;
    return SF_OK;
}

/* What is not for training is held out, and so is what several lists name. */
static sf_status read_split(reader *r) {
    sf_status status = sf_project_sort(r->project, r->file);
    int listed = json_object_get(r->root, "train_filenames") != NULL;
    for (size_t i = 0; listed && i < r->project->count; i++) r->project->entries[i].split = SF_SPLIT_TEST;
    if (!status) status = mark(r, "train_filenames", SF_SPLIT_TRAIN);
    if (!status) status = mark(r, "val_filenames", SF_SPLIT_TEST);
    if (!status) status = mark(r, "test_filenames", SF_SPLIT_TEST);
    return status;
}

static sf_status read_points(reader *r) {
    frame top = {.r = r};
    const char *name;
    sf_status status = get_text(&top, "ply_file_path", &name);
    if (status || !name) return status;
    char *path;
    status = find_inside(&top, "ply_file_path", name, &path);
    if (status) return status;
    sf_project *p = r->project;
    if (sf_is_file(path))
        status = sf_ply_read_points(r->ctx, path, &p->xyz, &p->rgb, &p->points);
    else
        sf_log(r->ctx, SF_LOG_WARNING, "%s: ply_file_path: %s is no file: the scene has no points", r->file,
               path);
    sf_free(r->ctx, path);
    return status;
}

/* The whole. */

static sf_status read_all(reader *r) {
    json_t *root = NULL;
    sf_status status = sf_json_read(r->ctx, r->file, MAX_FILE_BYTES, &root);
    if (!status && !json_is_object(root))
        status = sf_fail(r->ctx, SF_ERR_FORMAT, "%s: JSON: the top level is not an object", r->file);
    r->root = root;
    if (!status) status = read_frames(r);
    if (!status) status = read_split(r);
    if (!status && !r->project->points) status = read_points(r);
    json_decref(root);
    return status;
}

static sf_status read_part(sf_project *project, const char *file, const sf_load_options *options,
                           sf_split split) {
    reader r = {.ctx = project->ctx, .project = project, .file = file, .options = options, .split = split};
    r.folder = sf_path_folder(r.ctx, file);
    if (!r.folder) return SF_ERR_MEMORY;
    sf_status status = sf_project_set_folder(project, r.folder);
    if (!status) sf_frame_images(r.ctx, r.folder, options->images, &r.images);
    if (!status) status = read_all(&r);
    sf_free(r.ctx, r.folder);
    return status;
}

sf_status sf_transforms_read(sf_project *project, const char *file, const sf_load_options *options) {
    project->kind = "transforms.json";
    return read_part(project, file, options, SF_SPLIT_TRAIN);
}

static sf_status read_named(sf_project *project, const char *folder, const char *name,
                            const sf_load_options *options, sf_split split) {
    char *file = sf_path_join(project->ctx, folder, name);
    sf_status status = file ? read_part(project, file, options, split) : SF_ERR_MEMORY;
    sf_free(project->ctx, file);
    return status;
}

sf_status sf_transforms_read_pair(sf_project *project, const char *folder, const sf_load_options *options) {
    static const char test[] = "transforms_test.json", val[] = "transforms_val.json";
    const char *held_out = sf_holds_file(folder, test) ? test : sf_holds_file(folder, val) ? val : NULL;
    project->kind = "Blender";
    project->blends = 1;
    if (held_out == test && sf_holds_file(folder, val))
        sf_log(project->ctx, SF_LOG_INFO, "%s: %s is held out, %s is not read", folder, test, val);
    sf_status status = read_named(project, folder, "transforms_train.json", options, SF_SPLIT_TRAIN);
    if (status || !held_out) return status;
    project->has_split = 1;
    return read_named(project, folder, held_out, options, SF_SPLIT_TEST);
}
