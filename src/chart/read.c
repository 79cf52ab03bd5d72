/* read.c - logs of fits and ablations, field by field: what is missing or wrong is named. */
#include "chart.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/statistics.h"

enum { LOG_BYTES = 1 << 26, PNG_BYTES = 1 << 26 };

/* Where in a file a field is: messages are "<path>: <where><name>: ...". */
typedef struct place {
    sf_context *ctx;
    const char *path;
    const json_t *object;
    const char *where;
} place;

static sf_status wrong(const place *p, const char *name, const char *what) {
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: %s%s: %s", p->path, p->where, name, what);
}

static sf_status number(const place *p, const char *name, double least, double most, double *value) {
    const json_t *field = json_object_get(p->object, name);
    if (!field) return wrong(p, name, "is missing");
    if (!json_is_number(field)) return wrong(p, name, "is not a number");
    *value = json_number_value(field);
    if (*value >= least && *value <= most) return SF_OK;
    return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: %s%s: %g is not in %g..%g", p->path, p->where, name, *value,
                   least, most);
}

/* A number that may be missing; *value stays then. */
static sf_status optional(const place *p, const char *name, double least, double most, double *value) {
    return json_object_get(p->object, name) ? number(p, name, least, most, value) : SF_OK;
}

static sf_status whole_number(const place *p, const char *name, int *value) {
    double number_value = 0;
    sf_status status = number(p, name, 0, 1e6, &number_value);
    if (!status) *value = (int)number_value;
    return status;
}

static sf_status text(const place *p, const char *name, char *value) {
    const json_t *field = json_object_get(p->object, name);
    if (!field) return wrong(p, name, "is missing");
    if (!json_is_string(field)) return wrong(p, name, "is not text");
    if (json_string_length(field) >= CHART_TEXT || !json_string_length(field))
        return wrong(p, name, "is empty or too long");
    strcpy(value, json_string_value(field));
    return SF_OK;
}

static sf_status inside(const place *p, const char *name, const char *where, place *in) {
    *in = (place){p->ctx, p->path, json_object_get(p->object, name), where};
    if (!in->object) return wrong(p, name, "is missing");
    return json_is_object(in->object) ? SF_OK : wrong(p, name, "is not an object");
}

/* The last name before an offset in JSON, which names the value that could not be parsed; "" without a name.
 */
static void name_before(const char *json, size_t at, char *name, size_t size) {
    *name = 0;
    while (at && json[at - 1] != ':') at--;
    size_t end = at ? at - 1 : 0;
    while (end && json[end - 1] != '"') end--;
    size_t begin = end ? end - 1 : 0;
    while (begin && json[begin - 1] != '"') begin--;
    if (begin)
        snprintf(name, size, "%.*s: ", (int)(end - 1 - begin < 60 ? end - 1 - begin : 60), json + begin);
}

static sf_status parse(sf_context *ctx, const char *path, json_t **json) {
    uint8_t *data;
    size_t size;
    json_error_t error;
    sf_status status = sf_read_text(ctx, path, LOG_BYTES, &data, &size);
    if (status) return status;
    *json = json_loadb((const char *)data, size, JSON_REJECT_DUPLICATES, &error);
    if (!*json) {
        char name[64];
        size_t at = error.position > 0 ? (size_t)error.position : 0;
        name_before((const char *)data, at < size ? at : size, name, sizeof name);
        status = sf_fail(ctx, SF_ERR_FORMAT, "%s: line %d: %s%s", path, error.line, name, error.text);
    }
    sf_free(ctx, data);
    return status;
}

/* The points of the curve at which held-out views were evaluated. */
static sf_status read_point(const place *p, chart_run *run) {
    chart_point point = {0};
    if (!json_object_get(p->object, "psnr") && json_is_object(p->object)) return SF_OK;
    sf_status status = number(p, "seconds", 1e-6, 1e9, &point.seconds);
    if (!status) status = number(p, "gaussians", 0, 1e10, &point.gaussians);
    if (!status) status = number(p, "psnr", -1000, 1000, &point.quality[CHART_PSNR]);
    if (!status) status = number(p, "ssim", -1, 1, &point.quality[CHART_SSIM]);
    if (!status && run->count && !(point.seconds > run->points[run->count - 1].seconds))
        status = wrong(p, "seconds", "is not later than the point before");
    if (!status) run->points[run->count++] = point;
    return status;
}

/* A list into an array with room for each of its objects. */
static sf_status read_list(const place *p, const char *name, void *array_pointer, size_t size,
                           sf_status (*read_item)(const place *, chart_run *), chart_run *run) {
    const json_t *list = json_object_get(p->object, name);
    if (!list) return SF_OK;
    if (!json_is_array(list)) return wrong(p, name, "is not a list");
    void *array = sf_calloc(p->ctx, json_array_size(list) + 1, size);
    sf_status status = array ? SF_OK : SF_ERR_MEMORY;
    memcpy(array_pointer, &array, sizeof array);
    for (size_t i = 0; i < json_array_size(list) && !status; i++) {
        char where[48];
        snprintf(where, sizeof where, "%s[%zu].", name, i);
        place at = {p->ctx, p->path, json_array_get(list, i), where};
        status = read_item(&at, run);
    }
    return status;
}

static sf_status read_curve(const place *p, chart_run *run) {
    if (!json_object_get(p->object, "curve")) return wrong(p, "curve", "is missing: not the log of a fit");
    sf_status status = read_list(p, "curve", &run->points, sizeof *run->points, read_point, run);
    if (!status && !run->count)
        status = wrong(p, "curve", "no point has psnr: fit with --eval-at or --eval-every");
    return status;
}

/* A file's name in a log is from the log's folder on. */
static sf_status read_png(const place *p, chart_snapshot *snapshot) {
    char name[1024], path[4096];
    const json_t *field = json_object_get(p->object, "file");
    const char *slash = strrchr(p->path, '/'), *file = json_string_value(field);
    if (!file) return wrong(p, "file", field ? "is not text" : "is missing");
    int room = snprintf(path, sizeof path, "%.*s%s", *file == '/' || !slash ? 0 : (int)(slash + 1 - p->path),
                        p->path, file);
    if (room < 0 || (size_t)room >= sizeof path) return wrong(p, "file", "is too long");
    if (sf_read_file(p->ctx, path, PNG_BYTES, &snapshot->png, &snapshot->size)) {
        snprintf(name, sizeof name, "%s", sf_last_error(p->ctx));
        return wrong(p, "file", name);
    }
    int png = snapshot->size > 8 && !memcmp(snapshot->png, "\x89PNG\r\n\x1a\n", 8);
    return png ? SF_OK : wrong(p, "file", "is not a PNG");
}

static sf_status read_snapshot(const place *p, chart_run *run) {
    chart_snapshot *snapshot = &run->snapshots[run->snapshot_count++];
    sf_status status = whole_number(p, "second", &snapshot->second);
    if (!status) status = number(p, "seconds", 0, 1e9, &snapshot->seconds);
    if (!status && snapshot->second) status = number(p, "psnr", -1000, 1000, &snapshot->psnr);
    return status ? status : read_png(p, snapshot);
}

static sf_status read_label(const place *p, chart_run *run) {
    char preset[CHART_TEXT], both[2 * CHART_TEXT + 4];
    if (json_object_get(p->object, "label")) return text(p, "label", run->label);
    strcpy(run->label, run->isa);
    if (!json_object_get(p->object, "preset")) return SF_OK;
    sf_status status = text(p, "preset", preset);
    if (status) return status;
    int n = snprintf(both, sizeof both, "%s / %s", preset, run->isa);
    if (n >= CHART_TEXT) return wrong(p, "preset", "is too long");
    memcpy(run->label, both, (size_t)n + 1);
    return SF_OK;
}

static sf_status read_machine(const place *p, chart_run *run) {
    place machine;
    sf_status status = inside(p, "machine", "machine.", &machine);
    if (!status) status = text(&machine, "cpu", run->cpu);
    if (!status) status = text(&machine, "isa", run->isa);
    if (!status) status = whole_number(&machine, "threads", &run->threads);
    if (!status) status = number(&machine, "load_start", -1, 1e6, &run->load_start);
    if (!status) status = number(&machine, "load_end", -1, 1e6, &run->load_end);
    return status;
}

static sf_status read_scene(const place *p, chart_run *run) {
    place scene;
    sf_status status = inside(p, "scene", "scene.", &scene);
    if (!status) status = text(&scene, "name", run->scene);
    if (!status) status = whole_number(&scene, "width", &run->width);
    if (!status) status = whole_number(&scene, "height", &run->height);
    return status;
}

static sf_status read_degrees(const place *p, chart_run *run) {
    const json_t *list = json_object_get(p->object, "sh_degrees");
    if (!list) return SF_OK;
    if (json_array_size(list) != CHART_DEGREES) return wrong(p, "sh_degrees", "is not a list of 4 numbers");
    for (size_t i = 0; i < CHART_DEGREES; i++) {
        const json_t *item = json_array_get(list, i);
        if (!json_is_number(item) || !(json_number_value(item) >= 0))
            return wrong(p, "sh_degrees", "holds what is not a number from 0 on");
        run->degrees[i] = json_number_value(item);
    }
    return SF_OK;
}

/* Which series it belongs to by its own word. */
static sf_status read_series(const place *p, chart_run *run) {
    static const char *const names[CHART_SERIES] = {NULL, "caps", "auto", "pruned", "random"};
    const json_t *options = json_object_get(p->object, "options");
    const char *size = json_string_value(json_object_get(options, "size"));
    char name[CHART_TEXT];
    run->timed = 1;
    run->cap = json_number_value(json_object_get(options, "max_gaussians"));
    if (size && !strcmp(size, names[CHART_AUTO])) run->series = CHART_AUTO;
    if (!json_object_get(p->object, "series")) return SF_OK;
    sf_status status = text(p, "series", name);
    if (status) return status;
    run->timed = 0;
    for (int s = CHART_CAPS; s < CHART_SERIES; s++)
        if (!strcmp(name, names[s])) {
            run->series = (chart_series)s;
            return SF_OK;
        }
    return wrong(p, "series", "is none of caps, auto, pruned, random");
}

static sf_status read_result(const place *p, chart_run *run) {
    place result;
    sf_status status = inside(p, "result", "result.", &result);
    if (!status) status = number(&result, "steps", 0, 1e12, &run->steps);
    if (!status) status = number(&result, "seconds", 0, 1e9, &run->seconds);
    if (!status) status = number(&result, "setup_seconds", 0, 1e9, &run->setup_seconds);
    if (!status) status = number(&result, "evaluation_seconds", 0, 1e9, &run->evaluation_seconds);
    if (!status) status = number(&result, "gaussians", 0, 1e10, &run->gaussians);
    if (!status) status = number(&result, "needles", 0, 1, &run->needles);
    run->train[CHART_PSNR] = run->train[CHART_SSIM] = NAN;
    if (!status) status = optional(&result, "bytes", 0, 1e15, &run->bytes);
    if (!status) status = optional(&result, "train_psnr", -1000, 1000, &run->train[CHART_PSNR]);
    if (!status) status = optional(&result, "train_ssim", -1, 1, &run->train[CHART_SSIM]);
    if (!status) status = read_degrees(&result, run);
    return status;
}

static sf_status read_run(const place *p, chart_run *run) {
    sf_status status = read_curve(p, run);
    if (!status) status = read_machine(p, run);
    if (!status) status = read_scene(p, run);
    if (!status) status = read_label(p, run);
    if (!status) status = number(p, "seed", 0, 1e19, &run->seed);
    if (!status) status = read_result(p, run);
    if (!status) status = read_series(p, run);
    return status ? status
                  : read_list(p, "snapshots", &run->snapshots, sizeof *run->snapshots, read_snapshot, run);
}

static void free_run(sf_context *ctx, chart_run *run) {
    for (size_t i = 0; i < run->snapshot_count; i++) sf_free(ctx, run->snapshots[i].png);
    sf_free(ctx, run->snapshots);
    sf_free(ctx, run->points);
}

/* Fits of one label with other caps are no seeds of each other, but a series. */
static void find_caps(chart_input *input, chart_run *run) {
    for (size_t i = 0; i + 1 < input->run_count; i++) {
        chart_run *other = &input->runs[i];
        int free_both =
            run->series <= CHART_CAPS && other->series <= CHART_CAPS && run->cap > 0 && other->cap > 0;
        if (!free_both || run->cap == other->cap || !chart_same_scene(run, other) ||
            strcmp(run->label, other->label) != 0)
            continue;
        run->series = other->series = CHART_CAPS;
        run->timed = other->timed = 0;
    }
}

static sf_status add_run(chart_input *input, const char *path, const json_t *json) {
    place p = {input->ctx, path, json, ""};
    chart_run run = {0};
    sf_status status = read_run(&p, &run);
    if (!status)
        status = sf_grow(input->ctx, &input->runs, &input->run_room, input->run_count, input->run_count + 1,
                         sizeof run);
    if (status)
        free_run(input->ctx, &run);
    else
        input->runs[input->run_count++] = run;
    if (!status) find_caps(input, &input->runs[input->run_count - 1]);
    return status;
}

static sf_status read_move(const place *p, chart_move *move) {
    sf_status status = json_is_object(p->object) ? SF_OK : wrong(p, "move", "is missing");
    if (!status) status = text(p, "move", move->name);
    if (!status) status = number(p, "seconds", 0, 1e9, &move->seconds);
    if (!status) status = number(p, "steps", 0, 1e12, &move->steps);
    return status ? status : number(p, "psnr", -1000, 1000, &move->psnr);
}

/* A name that is good for a file too. */
static void name_of_file(const char *path, char *name) {
    const char *slash = strrchr(path, '/'), *from = slash ? slash + 1 : path, *dot = strrchr(from, '.');
    int n = (int)(dot && dot > from ? dot - from : (ptrdiff_t)strlen(from));
    snprintf(name, CHART_TEXT, "%.*s", n, from);
    for (char *c = name; *c; c++)
        if ((unsigned char)*c < ' ' || (unsigned char)*c > 126) *c = '-';
}

static sf_status add_ablation(chart_input *input, const char *path, const json_t *json) {
    chart_ablation ablation = {.count = json_array_size(json)};
    place whole = {input->ctx, path, json, ""};
    if (!ablation.count) return wrong(&whole, "move", "the list is empty");
    name_of_file(path, ablation.name);
    ablation.moves = sf_calloc(input->ctx, ablation.count, sizeof *ablation.moves);
    sf_status status = ablation.moves ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; i < ablation.count && !status; i++) {
        char where[48];
        snprintf(where, sizeof where, "[%zu].", i);
        place at = {input->ctx, path, json_array_get(json, i), where};
        status = read_move(&at, &ablation.moves[i]);
    }
    if (!status)
        status = sf_grow(input->ctx, &input->ablations, &input->ablation_room, input->ablation_count,
                         input->ablation_count + 1, sizeof ablation);
    if (status)
        sf_free(input->ctx, ablation.moves);
    else
        input->ablations[input->ablation_count++] = ablation;
    return status;
}

static sf_status read_choice(const place *p, chart_choice *choice) {
    sf_status status = json_is_object(p->object) ? SF_OK : wrong(p, "complexity", "is missing");
    strcpy(choice->series, "automatic choice");
    if (!status) status = number(p, "complexity", 1, 1e12, &choice->complexity);
    if (!status) status = number(p, "gaussians", 1, 1e12, &choice->gaussians);
    return !status && json_object_get(p->object, "series") ? text(p, "series", choice->series) : status;
}

static sf_status add_choices(chart_input *input, const char *path, const json_t *json) {
    chart_choices choices = {.count = json_array_size(json)};
    name_of_file(path, choices.name);
    choices.list = sf_calloc(input->ctx, choices.count, sizeof *choices.list);
    sf_status status = choices.list ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; i < choices.count && !status; i++) {
        char where[48];
        snprintf(where, sizeof where, "[%zu].", i);
        place at = {input->ctx, path, json_array_get(json, i), where};
        status = read_choice(&at, &choices.list[i]);
    }
    if (!status)
        status = sf_grow(input->ctx, &input->choices, &input->choices_room, input->choices_count,
                         input->choices_count + 1, sizeof choices);
    if (status)
        sf_free(input->ctx, choices.list);
    else
        input->choices[input->choices_count++] = choices;
    return status;
}

static sf_status read_keyframe(const place *p, chart_walk *walk, double *degrees) {
    svg_point *at = &walk->points[walk->count];
    sf_status status = number(p, "time", 0, 1e9, &at->x);
    if (!status) status = number(p, "distance", 0, 1e12, &at->y);
    if (!status) status = number(p, "degrees", 0, 180, degrees);
    if (!status && walk->count && at->x < at[-1].x)
        status = wrong(p, "time", "is before that of the keyframe before");
    walk->count += !status;
    return status;
}

/* What a live fit wrote of a simulated camera. */
static sf_status add_walk(chart_input *input, const char *path, const json_t *errors) {
    chart_walk walk = {.count = 0};
    size_t all = json_array_size(errors);
    double *degrees = sf_alloc(input->ctx, all, sizeof *degrees);
    name_of_file(path, walk.name);
    walk.points = sf_calloc(input->ctx, all, sizeof *walk.points);
    sf_status status = walk.points && degrees ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; i < all && !status; i++) {
        char where[64];
        snprintf(where, sizeof where, "result.keyframe_errors[%zu].", i);
        place at = {input->ctx, path, json_array_get(errors, i), where};
        status = read_keyframe(&at, &walk, &degrees[i]);
    }
    if (!status)
        status = sf_grow(input->ctx, &input->walks, &input->walk_room, input->walk_count,
                         input->walk_count + 1, sizeof walk);
    if (!status) walk.degrees = sf_median(degrees, all);
    if (status)
        sf_free(input->ctx, walk.points);
    else
        input->walks[input->walk_count++] = walk;
    sf_free(input->ctx, degrees);
    return status;
}

/* A log is one of a walk if keyframes are compared with the truth. */
static sf_status add_log(chart_input *input, const char *path, const json_t *json) {
    const json_t *errors = json_object_get(json_object_get(json, "result"), "keyframe_errors");
    return json_array_size(errors) ? add_walk(input, path, errors) : add_run(input, path, json);
}

/* A list is one of choices if its first object has a complexity. */
static sf_status add_list(chart_input *input, const char *path, const json_t *json) {
    int choices = json_object_get(json_array_get(json, 0), "complexity") != NULL;
    return choices ? add_choices(input, path, json) : add_ablation(input, path, json);
}

sf_status chart_read(chart_input *input, const char *path) {
    json_t *json = NULL;
    sf_status status = parse(input->ctx, path, &json);
    if (status) return status;
    status = json_is_array(json) ? add_list(input, path, json) : add_log(input, path, json);
    json_decref(json);
    return status;
}

void chart_free(chart_input *input) {
    for (size_t i = 0; i < input->run_count; i++) free_run(input->ctx, &input->runs[i]);
    for (size_t i = 0; i < input->ablation_count; i++) sf_free(input->ctx, input->ablations[i].moves);
    for (size_t i = 0; i < input->choices_count; i++) sf_free(input->ctx, input->choices[i].list);
    for (size_t i = 0; i < input->walk_count; i++) sf_free(input->ctx, input->walks[i].points);
    sf_free(input->ctx, input->walks);
    sf_free(input->ctx, input->choices);
    sf_free(input->ctx, input->runs);
    sf_free(input->ctx, input->ablations);
    *input = (chart_input){.ctx = input->ctx};
}
