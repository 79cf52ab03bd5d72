/* board.c - boards by name and by description; how one is drawn. */
#include "board.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "../sim/sheet.h"
#include "tags.h"

static const double LEAST_SIZE = 0.001, MOST_SIZE = 10; /* m */
static const uint64_t MAX_FILE_BYTES = 1 << 20;

/* A board and its memory. */
typedef struct own_board {
    sf_board board; /* first: what the caller holds */
    sf_context *ctx;
    sf_board_tag tags[SF_BOARD_MOST_TAGS];
} own_board;

sf_board_tag sf_board_place(int32_t id, double x, double y, double side, double angle) {
    static const double square[4][2] = {{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}};
    sf_board_tag tag = {.id = id};
    double c = side * cos(angle), s = side * sin(angle);
    for (int i = 0; i < 4; i++) {
        tag.corner[i][0] = x + c * square[i][0] - s * square[i][1];
        tag.corner[i][1] = y + s * square[i][0] + c * square[i][1];
    }
    return tag;
}

/* By name. */

static void make_sheet(const sf_sheet *sheet, own_board *b) {
    sf_board *board = &b->board;
    snprintf(board->name, sizeof board->name, "%s", sheet->name);
    snprintf(board->family, sizeof board->family, "tag36h11");
    board->tag_size = sheet->tag * 1e-3;
    board->width = sheet->width * 1e-3;
    board->height = sheet->height * 1e-3;
    board->count = SF_SHEET_TAGS;
    for (int i = 0; i < SF_SHEET_TAGS; i++) {
        double x, y;
        sf_sheet_tag(sheet, i, &x, &y);
        b->tags[i] = sf_board_place(i, x * 1e-3, y * 1e-3, board->tag_size, 0);
    }
}

static sf_status find_sheet(sf_context *ctx, const char *name, own_board *b) {
    const sf_sheet *const sheets[] = {&sf_sheet_a4, &sf_sheet_letter, &sf_sheet_a3};
    for (size_t i = 0; i < sizeof sheets / sizeof *sheets; i++)
        if (!strcmp(sheets[i]->name, name)) {
            make_sheet(sheets[i], b);
            return SF_OK;
        }
    return sf_fail(ctx, SF_ERR_ARGUMENT,
                   "board: \"%s\" is none of a4-36h11, letter-36h11, a3-36h11, nor a .json file", name);
}

/* By description. */

static sf_status get_real(sf_context *ctx, const char *where, const json_t *object, const char *key,
                          const double *otherwise, double *value) {
    const json_t *number = json_object_get(object, key);
    if (!number && otherwise) {
        *value = *otherwise;
        return SF_OK;
    }
    if (!number) return sf_fail(ctx, SF_ERR_FORMAT, "%s: %s: is missing", where, key);
    if (!json_is_number(number)) return sf_fail(ctx, SF_ERR_FORMAT, "%s: %s: is not a number", where, key);
    *value = json_number_value(number);
    if (fabs(*value) < 1e6) return SF_OK;
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: %s: %g is out of range", where, key, *value);
}

static sf_status get_size(sf_context *ctx, const char *where, const json_t *object, const double *otherwise,
                          double *size) {
    sf_status status = get_real(ctx, where, object, "tag_size_m", otherwise, size);
    if (status || (*size >= LEAST_SIZE && *size <= MOST_SIZE)) return status;
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: tag_size_m: %g is not in %g..%g", where, *size, LEAST_SIZE,
                   MOST_SIZE);
}

static sf_status read_tag(sf_context *ctx, const char *path, const json_t *json, size_t index, own_board *b) {
    char where[512];
    double x, y, size, angle, zero = 0;
    int tags = sf_tags_in_family(b->board.family);
    snprintf(where, sizeof where, "%s: tags[%zu]", path, index);
    const json_t *id = json_object_get(json, "id");
    if (!json_is_integer(id)) return sf_fail(ctx, SF_ERR_FORMAT, "%s: id: is not a whole number", where);
    if (json_integer_value(id) < 0 || json_integer_value(id) >= tags)
        return sf_fail(ctx, SF_ERR_FORMAT, "%s: id: %lld is not in 0..%d", where,
                       (long long)json_integer_value(id), tags - 1);
    sf_status status = get_real(ctx, where, json, "x_m", NULL, &x);
    if (!status) status = get_real(ctx, where, json, "y_m", NULL, &y);
    if (!status) status = get_real(ctx, where, json, "angle_deg", &zero, &angle);
    if (!status) status = get_size(ctx, where, json, &b->board.tag_size, &size);
    if (!status)
        b->tags[index] =
            sf_board_place((int32_t)json_integer_value(id), x, y, size, angle * 3.141592653589793 / 180);
    return status;
}

static int by_id(const void *a, const void *b) {
    int32_t x = ((const sf_board_tag *)a)->id, y = ((const sf_board_tag *)b)->id;
    return (x > y) - (x < y);
}

static sf_status check_ids(sf_context *ctx, const char *path, own_board *b) {
    qsort(b->tags, b->board.count, sizeof *b->tags, by_id);
    for (size_t i = 1; i < b->board.count; i++)
        if (b->tags[i].id == b->tags[i - 1].id)
            return sf_fail(ctx, SF_ERR_FORMAT, "%s: tags: id %d stands twice", path, (int)b->tags[i].id);
    return SF_OK;
}

static sf_status read_family(sf_context *ctx, const char *path, const json_t *root, sf_board *board) {
    const json_t *family = json_object_get(root, "family");
    const char *name = family ? json_string_value(family) : "tag36h11";
    if (!name) return sf_fail(ctx, SF_ERR_FORMAT, "%s: family: is not a text", path);
    if (!sf_tags_in_family(name))
        return sf_fail(ctx, SF_ERR_UNSUPPORTED, "%s: family: \"%.40s\" is none of tag36h11, tag25h9, tag16h5",
                       path, name);
    snprintf(board->family, sizeof board->family, "%s", name);
    return SF_OK;
}

static sf_status read_description(sf_context *ctx, const char *path, const json_t *root, own_board *b) {
    const char *name = json_string_value(json_object_get(root, "name")), *slash = strrchr(path, '/');
    snprintf(b->board.name, sizeof b->board.name, "%.60s", name ? name : slash ? slash + 1 : path);
    sf_status status = read_family(ctx, path, root, &b->board);
    if (!status) status = get_size(ctx, path, root, NULL, &b->board.tag_size);
    if (status) return status;
    const json_t *tags = json_object_get(root, "tags");
    b->board.count = json_array_size(tags);
    if (!b->board.count) return sf_fail(ctx, SF_ERR_FORMAT, "%s: tags: is not a list of tags", path);
    if (b->board.count > SF_BOARD_MOST_TAGS)
        return sf_fail(ctx, SF_ERR_FORMAT, "%s: tags: %zu are more than %d", path, b->board.count,
                       SF_BOARD_MOST_TAGS);
    for (size_t i = 0; !status && i < b->board.count; i++)
        status = read_tag(ctx, path, json_array_get(tags, i), i, b);
    return status ? status : check_ids(ctx, path, b);
}

static sf_status load(sf_context *ctx, const char *path, own_board *b) {
    uint8_t *data;
    size_t size;
    json_error_t error;
    sf_status status = sf_read_text(ctx, path, MAX_FILE_BYTES, &data, &size);
    if (status) return status;
    json_t *root = json_loadb((const char *)data, size, JSON_REJECT_DUPLICATES, &error);
    sf_free(ctx, data);
    if (!root) return sf_fail(ctx, SF_ERR_FORMAT, "%s: line %d: %s", path, error.line, error.text);
    status = read_description(ctx, path, root, b);
    json_decref(root);
    return status;
}

/* Both. */

static void scale(own_board *b, double factor) {
    b->board.tag_size *= factor;
    b->board.width *= factor;
    b->board.height *= factor;
    for (size_t i = 0; i < b->board.count; i++)
        for (int k = 0; k < 4; k++)
            for (int a = 0; a < 2; a++) b->tags[i].corner[k][a] *= factor;
}

static int is_ending(const char *name, const char *ending) {
    size_t n = strlen(name), m = strlen(ending);
    return n > m && !strcmp(name + n - m, ending);
}

sf_status sf_board_open(sf_context *ctx, const char *name, double tag_size, sf_board **board) {
    *board = NULL;
    if (tag_size != 0 && !(tag_size >= LEAST_SIZE && tag_size <= MOST_SIZE))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "board: tag size: %g m is not in %g..%g", tag_size, LEAST_SIZE,
                       MOST_SIZE);
    own_board *b = sf_calloc(ctx, 1, sizeof *b);
    if (!b) return SF_ERR_MEMORY;
    b->ctx = ctx;
    b->board.tags = b->tags;
    sf_status status = is_ending(name, ".json") ? load(ctx, name, b) : find_sheet(ctx, name, b);
    if (status) {
        sf_free(ctx, b);
        return status;
    }
    if (tag_size != 0) scale(b, tag_size / b->board.tag_size);
    *board = &b->board;
    return SF_OK;
}

void sf_board_close(sf_board **board) {
    if (!*board) return;
    own_board *b = (own_board *)*board;
    sf_free(b->ctx, b);
    *board = NULL;
}

/* Drawing. */

/* Runs along rows and along columns: where a row of cells meets the next, a column covers the seam. */
static sf_status draw_runs(sf_sketch *s, const uint8_t *cells, int side, int along_rows, const double at[2],
                           double cell) {
    sf_status status = SF_OK;
    for (int line = 0; line < side; line++)
        for (int i = 0, run = 0; i <= side && !status; i++) {
            if (i < side && cells[along_rows ? line * side + i : i * side + line]) {
                run++;
                continue;
            }
            double start = (i - run) * cell, across = line * cell, length = run * cell;
            if (run && along_rows)
                status = sf_sketch_bar(s, at[0] + start, at[1] + across, length, cell);
            else if (run)
                status = sf_sketch_bar(s, at[0] + across, at[1] + start, cell, length);
            run = 0;
        }
    return status;
}

static sf_status draw_tag(sf_sketch *s, const sf_board *board, const sf_board_tag *tag) {
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    int side;
    sf_status status = sf_tags_cells(s->ctx, board->family, tag->id, &side, cells);
    if (status) return status;
    double at[2] = {tag->corner[0][0] * 1e3 + s->width / 2, tag->corner[0][1] * 1e3 + s->height / 2};
    double cell = board->tag_size * 1e3 / side;
    status = draw_runs(s, cells, side, 1, at, cell);
    return status ? status : draw_runs(s, cells, side, 0, at, cell);
}

/* 100 mm, a tick every 10. */
static sf_status draw_ruler(sf_sketch *s, double x, double y) {
    sf_status status = sf_sketch_bar(s, x, y, 100, 0.3);
    for (int i = 0; i <= 10 && !status; i++) {
        double tick = i % 5 ? 2 : 4, left = i == 0 ? x : i == 10 ? x + 99.8 : x + 10 * i - 0.1;
        status = sf_sketch_bar(s, left, y - tick, 0.2, tick);
    }
    return status ? status : sf_sketch_text(s, "100 mm", x + 103, y, 2.4);
}

static sf_status draw_board(sf_sketch *s, const sf_board *board) {
    char text[160];
    sf_status status = SF_OK;
    double left = board->tags[0].corner[0][0] * 1e3 + s->width / 2;
    double below = board->tags[board->count - 1].corner[2][1] * 1e3 + s->height / 2;
    for (size_t i = 0; i < board->count && !status; i++) status = draw_tag(s, board, &board->tags[i]);
    long size = lround(board->tag_size * 1e4); /* no locale's comma */
    snprintf(text, sizeof text, "%s: tag %ld.%ld mm: measure it; print at 100 %%", board->name, size / 10,
             size % 10);
    if (!status) status = sf_sketch_text(s, text, left, below + 14, 2.4);
    return status ? status : draw_ruler(s, left, below + 22);
}

static sf_status write_drawing(sf_context *ctx, const sf_board *board, const char *path,
                               sf_status (*write)(const sf_sketch *, const char *)) {
    sf_sketch s = {
        .ctx = ctx, .title = board->name, .width = board->width * 1e3, .height = board->height * 1e3};
    sf_status status = draw_board(&s, board);
    if (!status) status = write(&s, path);
    sf_sketch_free(&s);
    return status;
}

sf_status sf_board_write(sf_context *ctx, const sf_board *board, const char *path) {
    if (is_ending(path, ".json")) return sf_board_save(ctx, board, path);
    sf_status (*write)(const sf_sketch *, const char *) = is_ending(path, ".svg")   ? sf_sketch_svg
                                                          : is_ending(path, ".pdf") ? sf_sketch_pdf
                                                          : is_ending(path, ".png") ? sf_sketch_png
                                                                                    : NULL;
    if (!write) return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: ending: is none of .svg, .pdf, .png, .json", path);
    if (!(board->width > 0))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: board %s has no sheet to be drawn on", path, board->name);
    return write_drawing(ctx, board, path, write);
}

static json_t *describe_tag(const sf_board_tag *tag) {
    const double(*c)[2] = tag->corner;
    double x = (c[0][0] + c[2][0]) / 2, y = (c[0][1] + c[2][1]) / 2;
    double dx = c[1][0] - c[0][0], dy = c[1][1] - c[0][1];
    return json_pack("{s:i s:f s:f s:f s:f}", "id", (int)tag->id, "x_m", x, "y_m", y, "angle_deg",
                     atan2(dy, dx) * 180 / 3.141592653589793, "tag_size_m", hypot(dx, dy));
}

sf_status sf_board_save(sf_context *ctx, const sf_board *board, const char *path) {
    json_t *tags = json_array();
    for (size_t i = 0; tags && i < board->count; i++)
        if (json_array_append_new(tags, describe_tag(&board->tags[i]))) {
            json_decref(tags);
            tags = NULL;
        }
    json_t *root = json_pack("{s:s s:s s:f s:o}", "name", board->name, "family", board->family, "tag_size_m",
                             board->tag_size, "tags", tags);
    char *text = root ? json_dumps(root, JSON_INDENT(1) | JSON_REAL_PRECISION(12)) : NULL;
    json_decref(root);
    if (!text) return sf_fail(ctx, SF_ERR_MEMORY, "%s: no memory for the description", path);
    size_t size = strlen(text);
    text[size] = '\n'; /* in place of the 0 */
    sf_status status = sf_write_file(ctx, path, text, size + 1);
    free(text);
    return status;
}
