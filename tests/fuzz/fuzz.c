/* fuzz.c - see fuzz.h. */
#define _GNU_SOURCE
#include "fuzz.h"

#include <dirent.h>
#include <ftw.h>
#include <jansson.h>
#include <malloc.h>
#include <math.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Targets. */

#define ENTRY(name, repair) {#name, fuzz_##name, repair},
static const fuzz_target targets[] = {FUZZ_TARGETS(ENTRY)};
#undef ENTRY
enum { TARGETS = sizeof targets / sizeof *targets };

const fuzz_target *fuzz_target_at(size_t index) { return index < TARGETS ? &targets[index] : NULL; }

const fuzz_target *fuzz_target_find(const char *name) {
    for (size_t i = 0; i < TARGETS; i++)
        if (!strcmp(targets[i].name, name)) return &targets[i];
    return NULL;
}

void (*fuzz_failed)(const char *what);

void fuzz_fail(const char *format, ...) {
    char what[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    if (fuzz_failed) fuzz_failed(what);
    fprintf(stderr, "%s\n", what);
    abort();
}

/* Memory. The library looks for an address of 64 k - 8 in what it is given; where each block begins at one,
 * blocks end where the library's do, and a sanitizer sees the first byte behind them. */

enum { LIBRARY_OFFSET = 56 };

static atomic_size_t held, json_held, most_held;

static void count(atomic_size_t *counter, size_t size) {
    atomic_fetch_add(counter, size);
    FUZZ_CHECK(held + json_held <= most_held, "memory: %zu bytes at once are more than the %zu allowed",
               (size_t)(held + json_held), (size_t)most_held);
}

static void *library_take(void *user, size_t size) {
    void *block;
    (void)user;
    count(&held, size);
    if (posix_memalign(&block, 64, LIBRARY_OFFSET + size)) fuzz_fail("memory: %zu bytes cannot be had", size);
    uint8_t *given = (uint8_t *)block + LIBRARY_OFFSET;
    memcpy(given - sizeof size, &size, sizeof size);
    return given;
}

static void library_give(void *user, void *given) {
    size_t size;
    (void)user;
    memcpy(&size, (uint8_t *)given - sizeof size, sizeof size);
    atomic_fetch_sub(&held, size);
    free((uint8_t *)given - LIBRARY_OFFSET);
}

/* Blocks of the C library's, since texts of JSON are given back by free. */
static void *json_take(size_t size) {
    void *block = malloc(size);
    count(&json_held, block ? malloc_usable_size(block) : 0);
    return block;
}

static void json_give(void *block) {
    if (block) atomic_fetch_sub(&json_held, malloc_usable_size(block));
    free(block);
}

/* The context. */

static int is_one_line(const char *text) {
    for (; *text; text++)
        if ((unsigned char)*text < ' ' || *text == 127) return 0;
    return 1;
}

static void check_log(void *user, sf_log_level level, const char *message) {
    (void)user, (void)level;
    FUZZ_CHECK(*message && is_one_line(message), "log: \"%s\" is not one line", message);
}

static sf_context *context;
static size_t held_before;

static void close_context(void) { sf_context_destroy(&context); }

static void open_context(void) {
    static const sf_allocator allocator = {library_take, library_give, NULL};
    const sf_context_options options = {
        .allocator = &allocator, .log = check_log, .threads = 1, .isa = "scalar"};
    most_held = SIZE_MAX;
    FUZZ_CHECK(!sf_context_create(&context, &options), "no context");
    json_set_alloc_funcs(json_take, json_give);
    json_object_seed(1); /* or it would differ from run to run */
    atexit(close_context);
}

sf_context *fuzz_begin(size_t size, size_t base, size_t multiple) {
    if (!context) open_context();
    held_before = held;
    json_held = 0;
    most_held = held_before + base + multiple * size;
    return context;
}

void fuzz_end(void) {
    FUZZ_CHECK(held == held_before, "memory: %zu bytes were not given back", (size_t)held - held_before);
    most_held = SIZE_MAX;
}

const char *fuzz_last_error(void) { return sf_last_error(context); }

int fuzz_went_well(sf_context *ctx, sf_status status, const char *name) {
    if (!status) return 1;
    const char *error = sf_last_error(ctx);
    FUZZ_CHECK(*error && is_one_line(error), "error: \"%s\" is not one line", error);
    FUZZ_CHECK(strstr(error, name), "error: \"%s\" does not name %s", error, name);
    return 0;
}

/* Files. */

static char folder[256];

static int remove_entry(const char *path, const struct stat *st, int type, struct FTW *ftw) {
    (void)st, (void)type, (void)ftw;
    return remove(path);
}

static void remove_folder(void) { nftw(folder, remove_entry, 16, FTW_DEPTH | FTW_PHYS); }

/* The scratch folder, in memory where there is such a file system. */
static const char *scratch_folder(void) {
    const char *base = getenv("TMPDIR");
    if (folder[0]) return folder;
    if (!base || !*base) base = access("/dev/shm", W_OK) ? "/tmp" : "/dev/shm";
    snprintf(folder, sizeof folder, "%s/splatfit-fuzz-XXXXXX", base);
    FUZZ_CHECK(mkdtemp(folder), "%s: cannot be made", folder);
    atexit(remove_folder);
    return folder;
}

const char *fuzz_path(const char *name) {
    static char paths[8][512];
    static unsigned turn;
    char *path = paths[turn++ % 8];
    snprintf(path, sizeof paths[0], "%s/%s", scratch_folder(), name);
    return path;
}

const char *fuzz_file(const char *name, const void *data, size_t size) {
    const char *path = fuzz_path(name);
    FILE *file = fopen(path, "wb");
    FUZZ_CHECK(file, "%s: cannot be opened", path);
    size_t put = size ? fwrite(data, 1, size, file) : 0;
    FUZZ_CHECK(!fclose(file) && put == size, "%s: cannot be written", path);
    return path;
}

const char *fuzz_subfolder(const char *name) {
    const char *path = fuzz_path(name);
    mkdir(path, 0777);
    return path;
}

void fuzz_clear(const char *name) {
    const char *path = fuzz_path(name);
    DIR *dir = opendir(path);
    for (struct dirent *e; dir && (e = readdir(dir));)
        if (*e->d_name != '.') unlinkat(dirfd(dir), e->d_name, 0);
    if (dir) closedir(dir);
}

/* Parts. */

sf_bytes fuzz_rest(sf_bytes *input) {
    size_t size = sf_bytes_left(input);
    return (sf_bytes){.data = sf_bytes_take(input, size), .size = size};
}

sf_bytes fuzz_part(sf_bytes *input) {
    size_t size = (size_t)sf_bytes_uint(input, sf_bytes_left(input) < 2 ? 0 : 2);
    if (size > sf_bytes_left(input)) size = sf_bytes_left(input);
    return (sf_bytes){.data = sf_bytes_take(input, size), .size = size};
}

/* What the program says. */

static FILE *own_stderr, *heard;
static char *heard_text;
static size_t heard_size;

void fuzz_listen(void) {
    own_stderr = stderr;
    heard = open_memstream(&heard_text, &heard_size);
    FUZZ_CHECK(heard, "no memory to listen");
    stderr = heard;
}

const char *fuzz_heard(void) {
    static char text[8192];
    stderr = own_stderr;
    fclose(heard);
    snprintf(text, sizeof text, "%s", heard_text);
    free(heard_text);
    return text;
}

/* Renders. */

void fuzz_render(sf_context *ctx, const sf_model *model) {
    enum { SIDE = 16 };
    float rgb[SIDE * SIDE * 3];
    const sf_camera camera = {.width = SIDE,
                              .height = SIDE,
                              .fx = SIDE,
                              .fy = SIDE,
                              .cx = SIDE / 2.0,
                              .cy = SIDE / 2.0,
                              .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                              .t_cw = {0, 0, 2}};
    const sf_image_out out = {.rgb = rgb};
    sf_renderer *renderer;
    FUZZ_CHECK(!sf_renderer_create(ctx, &renderer), "renderer: %s", sf_last_error(ctx));
    FUZZ_CHECK(!sf_render(renderer, model, &camera, NULL, &out), "render: %s", sf_last_error(ctx));
    for (int i = 0; i < SIDE * SIDE * 3; i++)
        FUZZ_CHECK(isfinite(rgb[i]), "render: value %d is not finite", i);
    sf_renderer_destroy(&renderer);
}
