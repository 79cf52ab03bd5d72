/* testing.h - what the tests share: cmocka, a context whose log is kept, a scratch folder, a skip with its
 * reason.
 *
 * Each tests/unit/test_*.c and tests/golden/test_*.c is a separate program, run from the top of the tree.
 */
#ifndef TESTING_H
#define TESTING_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include <cmocka.h>
#include <jansson.h>

#include <splatfit/splatfit.h>

/* Lines that the contexts of test_context logged since the last test_log_clear, each ended by a newline. */
extern char test_log[65536];
void test_log_clear(void);

/* A context with 2 threads that logs to test_log; fails the test if it cannot be had. */
sf_context *test_context(void);
sf_context *test_context_threads(int threads);

/* An allocator that counts, and whose fail_at-th call (from 1; 0: none) gives nothing. */
typedef struct test_allocations {
    atomic_long calls, live;
    long fail_at;
} test_allocations;
void *test_count_alloc(void *allocations, size_t size);
void test_count_free(void *allocations, void *block);

/* An allocator that refuses one allocation, that which comes after `*countdown` others; -1: none. */
void *test_refuse_alloc(void *countdown, size_t size);
void test_refuse_free(void *countdown, void *block);

/* Asserts status == expected and, where it is not, prints sf_last_error. */
#define assert_status(ctx, call, expected) test_assert_status(ctx, call, expected, #call, __FILE__, __LINE__)
#define assert_ok(ctx, call)               assert_status(ctx, call, SF_OK)
void test_assert_status(const sf_context *ctx, sf_status got, sf_status expected, const char *call,
                        const char *file, int line);

/* Asserts that sf_last_error holds `part`. */
#define assert_error_names(ctx, part) test_assert_contains(sf_last_error(ctx), part, __FILE__, __LINE__)
void test_assert_contains(const char *text, const char *part, const char *file, int line);

/* Asserts least <= value <= most, whole numbers of 0 and above. */
#define assert_between(value, least, most)                                                                   \
    test_assert_between((uintmax_t)(value), (uintmax_t)(least), (uintmax_t)(most), #value, __FILE__, __LINE__)
void test_assert_between(uintmax_t value, uintmax_t least, uintmax_t most, const char *text, const char *file,
                         int line);

/* A scratch folder of this program, removed with all that is in it when the program ends. */
const char *test_folder(void);
/* "<test_folder>/<name>", in one of 16 buffers of the thread, used in turn. */
const char *test_path(const char *name);
/* The same of "<inside>/<name>". */
const char *test_path_in(const char *inside, const char *name);
void test_write(const char *path, const void *data, size_t size);
/* The content of a file, free()d by the caller; fails the test if it cannot be read. */
uint8_t *test_read(const char *path, size_t *size);
int test_exists(const char *path);
/* Entries of a folder whose name is not . or .. ; -1 if it cannot be opened. */
int test_count_entries(const char *path);

/* The scene of a project, which must load; its figures; view `index` of it, which must be there. */
sf_scene *test_load_scene(sf_context *ctx, const char *path, const sf_load_options *options);
sf_scene_info test_scene_info(sf_scene *scene);
sf_view_info test_view_info(sf_scene *scene, size_t index);

/* Turns a camera: its axes to the right and ahead, unit vectors of the world at right angles. */
void test_turn_camera(sf_camera *camera, const double right[3], const double ahead[3]);
/* Puts its centre at a place of the world; it keeps its direction. */
void test_move_camera(sf_camera *camera, const double at[3]);

/* Camera `view` of `views` on a ring 4 about the middle, upright, that look inwards; f = 60 px. */
sf_camera test_camera_around(int view, int views, int width, int height);

/* The JSON of a file, which the caller releases, and a number in an object; the test fails without it.
 */
json_t *test_json(const char *path);
double test_number(const json_t *object, const char *key);

void test_pause_ms(long ms);

/* The words of RUN, which run a program of another machine here; how many. */
size_t test_runner(char **command, size_t limit);

/* A test program that runs itself once more calls test_begin first of all. test_start starts that other
 * process, in which test_begin calls `begin`, and returns once that has returned or called test_say_begun.
 * The process holds what it took until test_kill, by SIGKILL. A fork alone would not do: where other threads
 * run, as those of libraries do, the child may inherit a locked allocator (clang 14's address sanitizer).
 */
void test_begin(int argc, char **argv, void (*begin)(sf_context *ctx, const char *path));
void test_say_begun(void);
pid_t test_start(const char *path);
void test_kill(pid_t pid);

/* Of the training views only `wanted` stay, evenly spread. */
void test_thin_out(sf_context *ctx, sf_scene *scene, size_t wanted);

/* Means of the figures of a fitter's model over the views of one split of its scene; over the held-out ones.
 */
sf_quality test_quality(sf_context *ctx, sf_scene *scene, sf_fitter *fitter, sf_split split);
sf_quality test_held_out(sf_context *ctx, sf_scene *scene, sf_fitter *fitter);

/* What a test does to a training view on its way into a scene; number: 0, 1, ... of the training views. */
typedef void (*test_change)(void *user, size_t number, sf_camera *camera, uint8_t *rgb);
/* A view of `from` once more in `to`, with another split; returns its id there. */
uint32_t test_copy_view(sf_context *ctx, sf_scene *from, sf_view_info view, sf_scene *to, sf_split split);
/* Views alone, in their order; change (NULL: none) is called of training views. */
void test_copy_views(sf_context *ctx, sf_scene *from, sf_scene *to, test_change change, void *user);
/* A simulated scene loaded anew, its training views changed (NULL: as they are); held-out views and points
 * stay. */
sf_scene *test_changed_scene(sf_context *ctx, const char *name, test_change change, void *user);

/* Loading a model fails with this status, in one line that names the path and `part`. */
void test_refuse_model(sf_context *ctx, const char *path, sf_status expected, const char *part);
/* The picture of a model, rgb: [height][width][3]. */
void test_draw(sf_context *ctx, const sf_model *model, const sf_camera *camera, float *rgb);
/* Opens a source and takes a frame, with one allocation failing after another, until all succeed: each
 * failure is SF_ERR_MEMORY, and leaves nothing behind. memory: of the context's allocator; name: of the
 * source, made anew each time; least: there are more failures than that. */
void test_source_without_memory(sf_context *ctx, test_allocations *memory, const char *(*name)(void),
                                long least);

/* The folder named by SPLATFIT_DATA, or ends the test as skipped, saying that the variable is not set. */
const char *test_data(void);
/* Whether SPLATFIT_QUICK is set, but to 0: each instruction is slow, so tests do less. */
int test_is_quick(void);
/* Ends the test as skipped with the reason printed. */
void test_skip(const char *reason);
/* Whether another machine is emulated (SPLATFIT_EMULATED, see tests/run.sh). */
int test_is_emulated(void);
/* Skips the rest where it is. */
void test_skip_emulated(void);

#endif
