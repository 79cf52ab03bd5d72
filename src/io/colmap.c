/* colmap.c - see colmap.h. */
#include "colmap.h"

#include "../base/bytes.h"
#include "../base/file.h"

#include <dirent.h>
#include <errno.h>
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const uint64_t MAX_FILE_BYTES = (uint64_t)1 << 36;

typedef struct camera {
    uint32_t id;
    int width, height;
    int supported; /* 0: pictures of this camera cannot be read */
    sf_optics lens;
} camera;

typedef struct reader {
    sf_context *ctx;
    sf_project *project;
    const char *model;    /* folder of the three files */
    const char *pictures; /* folder of the pictures */
    char *file;           /* the one being read */
    camera *cameras;      /* sorted by id once all are read */
    size_t camera_count, camera_capacity;
    uint32_t *image_ids;
    size_t image_count, image_capacity;
    size_t xyz_capacity, rgb_capacity; /* of the project's points */
} reader;

/* What all kinds of files give. */

typedef struct camera_record {
    uint64_t width, height;
    double parameters[SF_OPTICS_PARAMETERS];
    uint32_t id;
    const sf_lens_model *model;
} camera_record;

typedef struct image_record {
    uint32_t id, camera;
    double q[4], t[3];
    const char *name;
} image_record;

typedef struct point_record {
    double xyz[3];
    uint8_t rgb[3];
} point_record;

static sf_status unsupported(reader *r, const camera *c) {
    int panorama = !strcmp(c->lens.model, "EQUIRECTANGULAR"); /* no pinhole camera shows all of it */
    return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: camera %lu: model %s is not supported%s", r->file,
                   (unsigned long)c->id, c->lens.model,
                   panorama ? "" : "; colmap image_undistorter makes a PINHOLE of it");
}

static sf_status check_side(reader *r, uint32_t id, const char *side, uint64_t value) {
    if (value >= 1 && value <= SF_PICTURE_MAX_SIDE) return SF_OK;
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu: %s: %llu is not in 1..%d", r->file,
                   (unsigned long)id, side, (unsigned long long)value, SF_PICTURE_MAX_SIDE);
}

static sf_status add_camera(reader *r, const camera_record *record) {
    sf_status status = check_side(r, record->id, "width", record->width);
    if (!status) status = check_side(r, record->id, "height", record->height);
    if (!status)
        status = sf_grow(r->ctx, &r->cameras, &r->camera_capacity, r->camera_count, r->camera_count + 1,
                         sizeof *r->cameras);
    if (!status)
        r->cameras[r->camera_count++] =
            (camera){record->id, (int)record->width, (int)record->height, record->model->layout != NULL,
                     sf_optics_make(record->model, record->parameters)};
    return status;
}

static int by_id(const void *a, const void *b) {
    uint32_t x = ((const camera *)a)->id, y = ((const camera *)b)->id;
    return (x > y) - (x < y);
}

static sf_status sort_cameras(reader *r) {
    if (!r->camera_count) return SF_OK;
    qsort(r->cameras, r->camera_count, sizeof *r->cameras, by_id);
    for (size_t i = 1; i < r->camera_count; i++)
        if (r->cameras[i].id == r->cameras[i - 1].id)
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu appears twice", r->file,
                           (unsigned long)r->cameras[i].id);
    return SF_OK;
}

/* 0 if the quaternion (w, x, y, z) has no direction. */
static int rotation(const double quat[4], double R[9]) {
    double norm = sqrt(quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3]);
    if (!isfinite(norm) || norm < 1e-12) return 0;
    sf_rotation_from_quat(quat, R);
    return 1;
}

static sf_status add_image(reader *r, const image_record *record) {
    const camera *c = NULL;
    if (r->camera_count)
        c = bsearch(&(camera){.id = record->camera}, r->cameras, r->camera_count, sizeof *c, by_id);
    if (!c)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu: camera %lu does not exist", r->file,
                       (unsigned long)record->id, (unsigned long)record->camera);
    if (!c->supported) return unsupported(r, c);
    sf_status status = sf_grow(r->ctx, &r->image_ids, &r->image_capacity, r->image_count, r->image_count + 1,
                               sizeof *r->image_ids);
    sf_entry *e;
    if (!status) status = sf_project_add(r->project, r->file, r->pictures, record->name, &e);
    if (status) return status;
    r->image_ids[r->image_count++] = record->id;
    e->width = c->width;
    e->height = c->height;
    e->lens = c->lens;
    e->bad_pose = !rotation(record->q, e->R_cw) || !isfinite(record->t[0]) || !isfinite(record->t[1]) ||
                  !isfinite(record->t[2]);
    memcpy(e->t_cw, record->t, sizeof e->t_cw);
    return SF_OK;
}

static int by_value(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static sf_status check_image_ids(reader *r) {
    if (!r->image_count) return SF_OK;
    qsort(r->image_ids, r->image_count, sizeof *r->image_ids, by_value);
    for (size_t i = 1; i < r->image_count; i++)
        if (r->image_ids[i] == r->image_ids[i - 1])
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu appears twice", r->file,
                           (unsigned long)r->image_ids[i]);
    return SF_OK;
}

static sf_status make_room_for_points(reader *r, size_t more) {
    sf_project *p = r->project;
    sf_status status =
        sf_grow(r->ctx, &p->xyz, &r->xyz_capacity, p->points, p->points + more, 3 * sizeof *p->xyz);
    return status ? status : sf_grow(r->ctx, &p->rgb, &r->rgb_capacity, p->points, p->points + more, 3);
}

static sf_status add_point(reader *r, const point_record *record) {
    sf_status status = make_room_for_points(r, 1);
    if (status) return status;
    size_t at = 3 * r->project->points++;
    for (size_t k = 0; k < 3; k++) {
        double v = record->xyz[k];
        /* A value beyond floats is left out by the scene, with what is not finite. */
        r->project->xyz[at + k] = fabs(v) <= FLT_MAX ? (float)v : NAN;
        r->project->rgb[at + k] = record->rgb[k];
    }
    return SF_OK;
}

/* Binary files. */

/* The number of records, checked against the bytes that each takes at least. */
static sf_status read_count(reader *r, sf_bytes *b, const char *what, size_t least_bytes, uint64_t *count) {
    *count = sf_bytes_u64(b);
    if (b->failed) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: ends before the number of %ss", r->file, what);
    if (*count > sf_bytes_left(b) / least_bytes)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: number of %ss: %llu are more than its %llu bytes hold",
                       r->file, what, (unsigned long long)*count, (unsigned long long)b->size);
    return SF_OK;
}

static sf_status cut_off(reader *r, const char *what, uint64_t index, uint64_t count) {
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: ends within %s %llu of %llu", r->file, what,
                   (unsigned long long)index + 1, (unsigned long long)count);
}

static sf_status check_end(reader *r, const sf_bytes *b, const char *what, uint64_t count) {
    if (!sf_bytes_left(b)) return SF_OK;
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %llu bytes follow the last of %llu %ss", r->file,
                   (unsigned long long)sf_bytes_left(b), (unsigned long long)count, what);
}

static sf_status read_camera(reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    camera_record record = {.id = sf_bytes_u32(b)};
    uint32_t model = sf_bytes_u32(b);
    if (b->failed) return cut_off(r, "camera", index, count);
    record.model = sf_lens_model_at(model);
    if (!record.model)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu: model: number %ld is not known", r->file,
                       (unsigned long)record.id, (long)(int32_t)model);
    record.width = sf_bytes_u64(b);
    record.height = sf_bytes_u64(b);
    if (record.model->layout)
        for (size_t i = 0; record.model->layout[i]; i++) record.parameters[i] = sf_bytes_f64(b);
    else
        sf_bytes_take(b, 8 * (size_t)record.model->unread);
    return b->failed ? cut_off(r, "camera", index, count) : add_camera(r, &record);
}

static sf_status read_cameras(reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "camera", 4 + 4 + 8 + 8 + 2 * 8, &count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_camera(r, b, i, count);
    return status ? status : check_end(r, b, "camera", count);
}

static sf_status read_image(reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    image_record record = {.id = sf_bytes_u32(b)};
    for (int i = 0; i < 4; i++) record.q[i] = sf_bytes_f64(b);
    for (int i = 0; i < 3; i++) record.t[i] = sf_bytes_f64(b);
    record.camera = sf_bytes_u32(b);
    if (b->failed) return cut_off(r, "image", index, count);
    record.name = (const char *)b->data + b->at;
    const void *end = memchr(record.name, 0, sf_bytes_left(b));
    if (!end)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu: name: has no end", r->file,
                       (unsigned long)record.id);
    sf_bytes_take(b, (size_t)((const char *)end - record.name) + 1);
    uint64_t observations = sf_bytes_u64(b);
    if (b->failed) return cut_off(r, "image", index, count);
    if (observations > sf_bytes_left(b) / 24)
        return sf_fail(r->ctx, SF_ERR_FORMAT,
                       "%s: image %lu: number of points: %llu are more than the file holds", r->file,
                       (unsigned long)record.id, (unsigned long long)observations);
    sf_bytes_take(b, (size_t)observations * 24);
    return add_image(r, &record);
}

static sf_status read_images(reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "image", 4 + 7 * 8 + 4 + 1 + 8, &count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_image(r, b, i, count);
    return status ? status : check_end(r, b, "image", count);
}

static sf_status read_point(reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    point_record record;
    uint64_t id = sf_bytes_u64(b);
    for (int i = 0; i < 3; i++) record.xyz[i] = sf_bytes_f64(b);
    for (int i = 0; i < 3; i++) record.rgb[i] = sf_bytes_u8(b);
    sf_bytes_f64(b); /* error */
    uint64_t track = sf_bytes_u64(b);
    if (b->failed) return cut_off(r, "point", index, count);
    if (track > sf_bytes_left(b) / 8)
        return sf_fail(r->ctx, SF_ERR_FORMAT,
                       "%s: point %llu: track: %llu images are more than the file holds", r->file,
                       (unsigned long long)id, (unsigned long long)track);
    sf_bytes_take(b, (size_t)track * 8);
    return add_point(r, &record);
}

static sf_status read_points(reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "point", 8 + 3 * 8 + 3 + 8 + 8, &count);
    if (!status) status = make_room_for_points(r, (size_t)count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_point(r, b, i, count);
    return status ? status : check_end(r, b, "point", count);
}

/* Text files. */

typedef struct text {
    reader *r;
    char *next; /* line */
    char *at;   /* in the line */
    unsigned long line;
} text;

/* 0 at the end. The line is cut at its end and loses the spaces there. */
static int next_line(text *t) {
    if (!*t->next) return 0;
    size_t length = strcspn(t->next, "\n");
    t->at = t->next;
    t->next += length + (t->next[length] == '\n');
    while (length && strchr(" \t\r", t->at[length - 1])) length--;
    t->at[length] = 0;
    t->at += strspn(t->at, " \t");
    t->line++;
    return 1;
}

static int next_record(text *t) {
    while (next_line(t))
        if (*t->at && *t->at != '#') return 1;
    return 0;
}

static char *next_word(text *t) {
    char *word = t->at;
    t->at += strcspn(t->at, " \t");
    if (*t->at) *t->at++ = 0;
    t->at += strspn(t->at, " \t");
    return word;
}

static sf_status bad_word(text *t, const char *field, const char *word) {
    return sf_fail(t->r->ctx, SF_ERR_FORMAT, "%s: line %lu: %s: '%s' is not a number in its range",
                   t->r->file, t->line, field, word);
}

static sf_status read_real(text *t, const char *field, double *value) {
    char *word = next_word(t), *end;
    *value = strtod(word, &end);
    return end == word || *end ? bad_word(t, field, word) : SF_OK;
}

static sf_status read_reals(text *t, const char *field, int count, double *values) {
    sf_status status = SF_OK;
    for (int i = 0; !status && i < count; i++) status = read_real(t, field, &values[i]);
    return status;
}

static sf_status read_integer(text *t, const char *field, uint64_t most, uint64_t *value) {
    char *word = next_word(t), *end;
    if (*word < '0' || *word > '9') return bad_word(t, field, word); /* strtoull takes signs */
    errno = 0;
    *value = strtoull(word, &end, 10);
    return *end || errno || *value > most ? bad_word(t, field, word) : SF_OK;
}

static sf_status read_id(text *t, const char *field, uint32_t *id) {
    uint64_t value = 0;
    sf_status status = read_integer(t, field, UINT32_MAX, &value);
    *id = (uint32_t)value;
    return status;
}

static sf_status read_model(text *t, camera_record *record) {
    const char *name = next_word(t);
    record->model = sf_lens_model_named(name);
    if (record->model) return SF_OK;
    return sf_fail(t->r->ctx, SF_ERR_FORMAT, "%s: line %lu: model: '%s' is not known", t->r->file, t->line,
                   name);
}

static sf_status read_parameters(text *t, camera_record *record) {
    if (record->model->layout)
        return read_reals(t, "parameters", (int)strlen(record->model->layout), record->parameters);
    double unread;
    sf_status status = SF_OK;
    for (int i = 0; !status && i < record->model->unread; i++) status = read_real(t, "parameters", &unread);
    return status;
}

static sf_status parse_camera(text *t) {
    camera_record record = {0};
    sf_status status = read_id(t, "camera id", &record.id);
    if (!status) status = read_model(t, &record);
    if (!status) status = read_integer(t, "width", UINT64_MAX, &record.width);
    if (!status) status = read_integer(t, "height", UINT64_MAX, &record.height);
    if (!status) status = read_parameters(t, &record);
    if (!status && *t->at) status = bad_word(t, "end of line", t->at);
    return status ? status : add_camera(t->r, &record);
}

static sf_status parse_cameras(reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_camera(&t);
    return status;
}

/* The line of observations is not used, but a line that is none shows that lines are missing. */
static sf_status skip_observations(text *t) {
    size_t words = 0;
    if (!next_line(t)) return SF_OK;
    for (; *t->at; words++) next_word(t);
    if (words % 3 == 0) return SF_OK;
    return sf_fail(t->r->ctx, SF_ERR_FORMAT, "%s: line %lu: observations: %zu words are not x, y, id each",
                   t->r->file, t->line, words);
}

static sf_status parse_image(text *t) {
    image_record record;
    sf_status status = read_id(t, "image id", &record.id);
    if (!status) status = read_reals(t, "quaternion", 4, record.q);
    if (!status) status = read_reals(t, "translation", 3, record.t);
    if (!status) status = read_id(t, "camera id", &record.camera);
    record.name = t->at;
    if (!status) status = add_image(t->r, &record);
    return status ? status : skip_observations(t);
}

static sf_status parse_images(reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_image(&t);
    return status;
}

static sf_status parse_point(text *t) {
    point_record record;
    uint64_t id, value = 0;
    sf_status status = read_integer(t, "point id", UINT64_MAX, &id);
    if (!status) status = read_reals(t, "position", 3, record.xyz);
    for (int i = 0; !status && i < 3; i++) {
        status = read_integer(t, "colour", 255, &value);
        record.rgb[i] = (uint8_t)value;
    }
    return status ? status : add_point(t->r, &record);
}

static sf_status parse_points(reader *r, char *data) {
    text t = {.r = r, .next = data};
    sf_status status = SF_OK;
    while (!status && next_record(&t)) status = parse_point(&t);
    return status;
}

/* A file of either kind. */

typedef struct file_kind {
    const char *binary, *text;
    sf_status (*read)(reader *r, sf_bytes *b);
    sf_status (*parse)(reader *r, char *data);
} file_kind;

static const file_kind cameras_file = {"cameras.bin", "cameras.txt", read_cameras, parse_cameras};
static const file_kind images_file = {"images.bin", "images.txt", read_images, parse_images};
static const file_kind points_file = {"points3D.bin", "points3D.txt", read_points, parse_points};

/* The name of the file that the folder holds, binary before text; NULL: neither. */
static const char *find_file(const char *folder, const file_kind *kind) {
    if (sf_holds_file(folder, kind->binary)) return kind->binary;
    return sf_holds_file(folder, kind->text) ? kind->text : NULL;
}

static int is_text(const char *path) { return !strcmp(path + strlen(path) - 4, ".txt"); }

/* Numbers have a point in every locale of the program. */
static sf_status parse_file(reader *r, const file_kind *kind, uint8_t *data, size_t size) {
    if (memchr(data, 0, size))
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: holds a zero byte: is not text", r->file);
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) return sf_fail(r->ctx, SF_ERR_MEMORY, "%s: out of memory", r->file);
    locale_t before = uselocale(plain);
    sf_status status = kind->parse(r, (char *)data);
    uselocale(before);
    freelocale(plain);
    return status;
}

static sf_status read_one(reader *r, const file_kind *kind) {
    uint8_t *data;
    size_t size;
    sf_status status =
        (is_text(r->file) ? sf_read_text : sf_read_file)(r->ctx, r->file, MAX_FILE_BYTES, &data, &size);
    if (status) return status;
    sf_bytes b = {.data = data, .size = size};
    status = is_text(r->file) ? parse_file(r, kind, data, size) : kind->read(r, &b);
    sf_free(r->ctx, data);
    return status;
}

/* `check` (may be NULL) runs over all that was read while the file's name still stands. */
static sf_status read_file(reader *r, const file_kind *kind, sf_status (*check)(reader *r)) {
    const char *name = find_file(r->model, kind);
    if (!name)
        return sf_fail(r->ctx, SF_ERR_IO, "%s: holds neither %s nor %s", r->model, kind->binary, kind->text);
    r->file = sf_path_join(r->ctx, r->model, name);
    if (!r->file) return SF_ERR_MEMORY;
    sf_status status = read_one(r, kind);
    if (!status && check) status = check(r);
    sf_free(r->ctx, r->file);
    r->file = NULL;
    return status;
}

static sf_status read_all(reader *r) {
    sf_status status = read_file(r, &cameras_file, sort_cameras);
    if (!status) status = read_file(r, &images_file, check_image_ids);
    if (status) return status;
    if (find_file(r->model, &points_file)) return read_file(r, &points_file, NULL);
    sf_log(r->ctx, SF_LOG_WARNING, "%s: no points3D.bin or points3D.txt: the scene has no points", r->model);
    return SF_OK;
}

/* A file of cameras alone. */

static sf_status take_one_camera(reader *r, int *width, int *height, sf_lens *lens) {
    if (!r->camera_count) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: holds no camera", r->file);
    const camera *first = r->cameras;
    if (!first->supported) return unsupported(r, first);
    if (!sf_optics_to_lens(&first->lens, lens))
        return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: camera %lu: model %s is not supported here", r->file,
                       (unsigned long)first->id, first->lens.model);
    for (size_t i = 1; i < r->camera_count; i++) {
        const camera *c = &r->cameras[i];
        if (c->width != first->width || c->height != first->height ||
            memcmp(&c->lens, &first->lens, sizeof c->lens))
            return sf_fail(r->ctx, SF_ERR_UNSUPPORTED,
                           "%s: holds %zu cameras that differ: one alone can be taken", r->file,
                           r->camera_count);
    }
    *width = first->width;
    *height = first->height;
    return SF_OK;
}

sf_status sf_colmap_read_camera(sf_context *ctx, const char *file, int binary, uint8_t *data, size_t size,
                                int *width, int *height, sf_lens *lens) {
    reader r = {.ctx = ctx};
    sf_bytes b = {.data = data, .size = size};
    r.file = sf_text_copy(ctx, file);
    if (!r.file) return SF_ERR_MEMORY;
    sf_status status = binary ? read_cameras(&r, &b) : parse_file(&r, &cameras_file, data, size);
    if (!status) status = sort_cameras(&r);
    if (!status) status = take_one_camera(&r, width, height, lens);
    sf_free(ctx, r.cameras);
    sf_free(ctx, r.file);
    return status;
}

/* The folder of the pictures. */

/* Part of a model is enough: what is missing is named when it is read. */
static int holds_model(const char *folder) {
    return find_file(folder, &cameras_file) || find_file(folder, &images_file);
}

/* The first of the usual folders in `path`; *pictures NULL: there is none. */
static sf_status look_for_pictures(sf_context *ctx, const char *path, const char *wanted, char **pictures) {
    static const char *const usual[] = {"images", "images_2", "images_4", "images_8"};
    for (size_t i = 0; i < (wanted ? 1 : 4); i++) {
        const char *name = wanted ? wanted : usual[i];
        *pictures = sf_path_join(ctx, path, name);
        if (!*pictures) return SF_ERR_MEMORY;
        if (sf_is_folder(*pictures)) {
            if (i)
                sf_log(ctx, SF_LOG_INFO, "%s: there is no images/: the pictures of %s/ are taken", path,
                       name);
            return SF_OK;
        }
        sf_free(ctx, *pictures);
    }
    *pictures = NULL;
    return SF_OK;
}

static sf_status no_pictures(sf_context *ctx, const char *path) {
    return sf_fail(ctx, SF_ERR_IO,
                   "%s: no folder of pictures: looked for images, images_2, images_4, images_8", path);
}

static int holds_any(const sf_project *p) {
    for (size_t i = 0; i < p->count; i++)
        if (sf_is_file(p->entries[i].path)) return 1;
    return !p->count;
}

/* The path may be that of the model itself, sparse/0: its project is above then. Otherwise *beside: pictures
 * are looked for in the model's folder, where RealityScan writes them. */
static sf_status find_pictures(sf_project *p, const char *path, const char *wanted, char **pictures,
                               int *beside) {
    static const char *const folders[] = {".", "..", "../.."};
    for (size_t i = 0; i < (holds_model(path) ? 3 : 1); i++) {
        char *folder = i ? sf_path_join(p->ctx, path, folders[i]) : sf_text_copy(p->ctx, path);
        if (!folder) return SF_ERR_MEMORY;
        sf_status status = look_for_pictures(p->ctx, folder, wanted, pictures);
        if (!status && *pictures) status = sf_project_set_folder(p, folder);
        sf_free(p->ctx, folder);
        if (status || *pictures) return status;
    }
    if (wanted) return sf_fail(p->ctx, SF_ERR_IO, "%s/%s: no such folder of pictures", path, wanted);
    if (!holds_model(path)) return no_pictures(p->ctx, path);
    *beside = 1;
    *pictures = sf_text_copy(p->ctx, path);
    return *pictures ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_colmap_read(sf_project *project, const char *path, const char *model,
                         const sf_load_options *options) {
    char *pictures = NULL;
    project->kind = "COLMAP";
    int beside = 0;
    sf_status status = find_pictures(project, path, options->images, &pictures, &beside);
    if (status) {
        sf_free(project->ctx, pictures);
        return status;
    }
    reader r = {.ctx = project->ctx, .project = project, .model = model, .pictures = pictures};
    status = read_all(&r);
    if (!status && beside && !holds_any(project)) status = no_pictures(project->ctx, path);
    sf_free(r.ctx, r.cameras);
    sf_free(r.ctx, r.image_ids);
    sf_free(r.ctx, pictures);
    return status;
}

/* The folder of the model. */

static uint64_t count_lines(char *data) {
    uint64_t count = 0;
    text t = {.next = data};
    while (next_record(&t)) {
        count++;
        next_line(&t);
    }
    return count;
}

static uint64_t count_binary(const char *path) {
    uint8_t data[8];
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    sf_bytes b = {.data = data, .size = fread(data, 1, sizeof data, file)};
    fclose(file);
    return sf_bytes_u64(&b);
}

static sf_status count_text(sf_context *ctx, const char *path, uint64_t *count) {
    uint8_t *data;
    size_t size;
    sf_status status = sf_read_text(ctx, path, MAX_FILE_BYTES, &data, &size);
    if (status) return status;
    *count = count_lines((char *)data);
    sf_free(ctx, data);
    return SF_OK;
}

/* A file that cannot be read counts as empty: another model is better. */
static sf_status count_images(sf_context *ctx, const char *folder, uint64_t *count) {
    *count = 0;
    const char *name = find_file(folder, &images_file);
    if (!name) return SF_OK;
    char *path = sf_path_join(ctx, folder, name);
    if (!path) return SF_ERR_MEMORY;
    sf_status status = SF_OK;
    if (is_text(path))
        status = count_text(ctx, path, count);
    else
        *count = count_binary(path);
    sf_free(ctx, path);
    return status == SF_ERR_MEMORY ? status : SF_OK;
}

typedef struct choice {
    char *folder; /* NULL: none yet */
    unsigned long number;
    uint64_t images;
    size_t models;
    int wanted; /* the number that must be taken; -1: any */
} choice;

/* Of models with as many images, the one with the lowest number: not the one that the file system lists
 * first. */
static int is_better(const choice *best, unsigned long number, uint64_t images) {
    return !best->folder || images > best->images || (images == best->images && number < best->number);
}

static sf_status consider(sf_context *ctx, const char *sparse, const char *name, choice *best) {
    if (name[strspn(name, "0123456789")] || strlen(name) > 9) return SF_OK;
    char *folder = sf_path_join(ctx, sparse, name);
    if (!folder) return SF_ERR_MEMORY;
    unsigned long number = strtoul(name, NULL, 10);
    uint64_t images = 0;
    int better = 0;
    sf_status status = SF_OK;
    if (holds_model(folder)) {
        best->models++;
        status = count_images(ctx, folder, &images);
        better = !status &&
                 (best->wanted < 0 ? is_better(best, number, images) : number == (unsigned long)best->wanted);
    }
    if (!better) {
        sf_free(ctx, folder);
        return status;
    }
    sf_free(ctx, best->folder);
    *best = (choice){folder, number, images, best->models, best->wanted};
    return SF_OK;
}

static sf_status consider_all(sf_context *ctx, const char *sparse, DIR *folder, choice *best) {
    sf_status status = SF_OK;
    while (!status) {
        errno = 0;
        const struct dirent *entry = readdir(folder);
        if (!entry && errno)
            return sf_fail(ctx, SF_ERR_IO, "%s: cannot be read: %s", sparse, strerror(errno));
        if (!entry) return SF_OK;
        status = consider(ctx, sparse, entry->d_name, best);
    }
    return status;
}

static sf_status choose_model(sf_context *ctx, const char *sparse, int number, char **model) {
    DIR *folder = opendir(sparse);
    if (!folder) return SF_OK;
    choice best = {.wanted = number};
    sf_status status = consider_all(ctx, sparse, folder, &best);
    closedir(folder);
    if (!status && best.models && !best.folder)
        return sf_fail(ctx, SF_ERR_IO, "%s: sub_model: none of its %zu models is %d", sparse, best.models,
                       number);
    if (best.models > 1 && number < 0)
        sf_log(ctx, SF_LOG_INFO, "%s: of %zu models, %lu is taken: it has most images, %llu", sparse,
               best.models, best.number, (unsigned long long)best.images);
    *model = best.folder;
    return status;
}

sf_status sf_colmap_find(sf_context *ctx, const char *path, int number, char **model) {
    *model = NULL;
    char *sparse = sf_path_join(ctx, path, "sparse");
    if (!sparse) return SF_ERR_MEMORY;
    sf_status status = choose_model(ctx, sparse, number, model);
    const char *others[] = {sparse, path};
    for (int i = 0; i < 2 && !status && !*model; i++) {
        if (!holds_model(others[i])) continue;
        *model = sf_text_copy(ctx, others[i]);
        if (!*model) status = SF_ERR_MEMORY;
    }
    if (status) {
        sf_free(ctx, *model);
        *model = NULL;
    }
    sf_free(ctx, sparse);
    return status;
}
