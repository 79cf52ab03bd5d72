/* fuzz.h - hostile input: one target a parser, and what the targets share.
 *
 * A target reads an input as its parser reads a file and lets go of all that it made. What must never happen
 * ends it by fuzz_fail: more memory than a stated multiple of the input, a failure without a line that says
 * why, memory that is not given back. The sanitizers see the rest. libfuzzer.c runs a target on inputs that
 * grow; tests/unit/test_hostile.c runs all targets on the inputs that are kept.
 */
#ifndef FUZZ_FUZZ_H
#define FUZZ_FUZZ_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/splatfit.h>

#include "base/bytes.h"
#include "io/sections.h"

/* Name, and what makes a mutated input worth reading (checksums), or NULL. */
#define FUZZ_TARGETS(F)                                                                                      \
    F(args, NULL)                                                                                            \
    F(board, NULL)                                                                                           \
    F(calibration, NULL)                                                                                     \
    F(cameras, NULL)                                                                                         \
    F(checkpoint, fuzz_repair_sections)                                                                      \
    F(colmap, NULL)                                                                                          \
    F(exif, NULL)                                                                                            \
    F(frames, NULL)                                                                                          \
    F(gltf, NULL)                                                                                            \
    F(jpeg_cut, NULL)                                                                                        \
    F(list, NULL)                                                                                            \
    F(log, NULL)                                                                                             \
    F(opensfm, NULL)                                                                                         \
    F(options, NULL)                                                                                         \
    F(picture, fuzz_repair_png)                                                                              \
    F(pipe, NULL)                                                                                            \
    F(ply, NULL)                                                                                             \
    F(poses, NULL)                                                                                           \
    F(replay, NULL)                                                                                          \
    F(sog, NULL)                                                                                             \
    F(source, NULL)                                                                                          \
    F(splat, NULL)                                                                                           \
    F(spz, NULL)                                                                                             \
    F(transforms, NULL)                                                                                      \
    F(y4m, NULL)                                                                                             \
    F(zip, NULL)

/* Reads an input; returns whether it was taken for what it should be. */
#define FUZZ_DECLARE(name, repair) int fuzz_##name(const uint8_t *data, size_t size);
FUZZ_TARGETS(FUZZ_DECLARE)
#undef FUZZ_DECLARE

/* In place: puts right the checksums of PNG's chunks, and of the sections of a checkpoint. */
void fuzz_repair_png(uint8_t *data, size_t size);
void fuzz_repair_sections(uint8_t *data, size_t size);
/* Puts a number that is odd into a section of a checkpoint, each as likely as the others. */
void fuzz_edit_sections(uint8_t *data, size_t size, unsigned seed);

/* Sections of a checkpoint, as io/sections.h lays them out: the file's header, and of each section its
 * header, its elements and their hash. */
enum { FUZZ_FILE_HEADER = 24, FUZZ_SECTION_HEADER = SF_SECTION_NAME + 24, FUZZ_SECTION_HASH = 8 };

typedef struct fuzz_section {
    size_t at, element, count; /* of its header in the file; bytes of an element; elements */
} fuzz_section;

/* The section whose header is at `at`, its length limited to the rest; 0: no section. */
int fuzz_section_at(const uint8_t *data, size_t size, size_t at, fuzz_section *s);
/* Where the next begins. */
size_t fuzz_section_end(const fuzz_section *s);
/* Little-endian. */
void fuzz_store(uint8_t *to, uint64_t value, size_t bytes);

typedef struct fuzz_target {
    const char *name;
    int (*run)(const uint8_t *data, size_t size);
    void (*repair)(uint8_t *data, size_t size);
} fuzz_target;

/* The index-th target, the target of that name; NULL: none. */
const fuzz_target *fuzz_target_at(size_t index);
const fuzz_target *fuzz_target_find(const char *name);

/* Says what must not happen and ends the program, or calls what stands here. */
extern void (*fuzz_failed)(const char *what);
#define FUZZ_CHECK(condition, ...)                                                                           \
    do {                                                                                                     \
        if (!(condition)) fuzz_fail(__VA_ARGS__);                                                            \
    } while (0)
_Noreturn void fuzz_fail(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The context of all targets, of one thread and of the plainest kernels. From fuzz_begin to fuzz_end what it
 * holds at once, JSON included, is at most base + multiple * size bytes, and all of it is given back. */
sf_context *fuzz_begin(size_t size, size_t base, size_t multiple);
void fuzz_end(void);

/* The library's last message. */
const char *fuzz_last_error(void);

/* Whether the call went well; a failure must have one line that names `name`, the file or the field. */
int fuzz_went_well(sf_context *ctx, sf_status status, const char *name);

/* A file in the scratch folder, which is in memory where there is such a file system; named anew by each
 * call.
 */
const char *fuzz_path(const char *name);
const char *fuzz_file(const char *name, const void *data, size_t size);
/* A folder in the scratch folder, and the removal of the files in it. */
const char *fuzz_subfolder(const char *name);
void fuzz_clear(const char *name);

/* A part of an input: 2 bytes of length, as far as there is so much. The last part is what is left. */
sf_bytes fuzz_part(sf_bytes *input);
sf_bytes fuzz_rest(sf_bytes *input);

/* What the program says on standard error from here on; the text since then, with standard error as it was.
 */
void fuzz_listen(void);
const char *fuzz_heard(void);

/* A finite render, 16 x 16, of whatever a file made. */
void fuzz_render(sf_context *ctx, const sf_model *model);

/* seeds.c: inputs that are right, FOLDER/<target>/<name>, for the formats that are not text. */
void fuzz_write_seeds(const char *folder);
/* The scene to which the checkpoints among them belong, and the options of their run. */
sf_scene *fuzz_scene(sf_context *ctx);

#endif
