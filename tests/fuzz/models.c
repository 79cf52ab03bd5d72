/* models.c - targets ply, spz, splat, gltf, sog: models, and the points of .ply files. */
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "fuzz.h"
#include "io/ply.h"
#include "io/zip_write.h"

/* The most that a Gaussian of a file becomes is 236 bytes: of 59 values of one byte, or of two characters;
 * a model that loses faulty ones is held twice. Of a compressed .ply 56 bytes, and 16 on the way, of four
 * words in eight characters. */
enum { BASE = 1 << 18, MULTIPLE = 20 };

/* What was read can be rendered and written; a failure names what `named` says. */
static int load_parts(sf_context *ctx, const char *path, const char *named,
                      const sf_model_file_options *options) {
    sf_model *model;
    int well = fuzz_went_well(ctx, sf_model_load_as(ctx, path, options, &model), named);
    if (!well) return 0;
    fuzz_render(ctx, model);
    FUZZ_CHECK(!sf_model_save(model, fuzz_path("again.ply")), "save: %s", sf_last_error(ctx));
    sf_model_destroy(&model);
    return 1;
}

static int load(sf_context *ctx, const char *path, const sf_model_file_options *options) {
    return load_parts(ctx, path, path, options);
}

int fuzz_ply(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, BASE, MULTIPLE);
    const char *path = fuzz_file("in.ply", data, size);
    sf_model_file_options options = sf_model_file_options_default();
    double *xyz;
    uint8_t *rgb;
    size_t count;
    options.format = SF_MODEL_PLY;
    int well = fuzz_went_well(ctx, sf_ply_read_points(ctx, path, &xyz, &rgb, &count), path);
    sf_free(ctx, xyz);
    sf_free(ctx, rgb);
    well |= load(ctx, path, &options);
    fuzz_end();
    return well;
}

int fuzz_splat(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, BASE, MULTIPLE);
    int well = load(ctx, fuzz_file("in.splat", data, size), NULL);
    fuzz_end();
    return well;
}

/* Of a .gltf that names itself as its 64 buffers each is held; JSON takes a hundred times its text. A
 * Gaussian is 236 bytes of a model of at least 3 of a buffer, held twice. */
int fuzz_gltf(const uint8_t *data, size_t size) {
    enum { AS_JSON = 128, AS_MODEL = 64 * 2 * 236 / 3 };
    sf_model_file_options options = sf_model_file_options_default();
    sf_context *ctx = fuzz_begin(size, BASE, AS_JSON + AS_MODEL);
    options.format = SF_MODEL_GLTF;
    int well = load(ctx, fuzz_file("in.gltf", data, size), &options);
    fuzz_end();
    return well;
}

/* As a stream of gzip. */
static const char *file_of(const uint8_t *data, size_t size, size_t *packed) {
    z_stream z = {.next_in = (Bytef *)(uintptr_t)data, .avail_in = (uInt)size};
    deflateInit2(&z, 1, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
    uLong room = deflateBound(&z, (uLong)size);
    uint8_t *file = malloc(room);
    FUZZ_CHECK(file, "out of memory");
    z.next_out = file;
    z.avail_out = (uInt)room;
    deflate(&z, Z_FINISH);
    *packed = z.total_out;
    deflateEnd(&z);
    const char *path = fuzz_file("in.spz", file, *packed);
    free(file);
    return path;
}

/* The first byte: 0, a file; else what is packed in one. What the reader holds at most is the stream as it
 * is unpacked, 16 MiB or 200 times the file, and 4 times that as a model, which is held twice where it loses
 * faulty ones. */
int fuzz_spz(const uint8_t *data, size_t size) {
    enum { UNPACKED = 1 << 24, RATIO = 200, AS_MODEL = 9 };
    sf_model_file_options options = sf_model_file_options_default();
    if (!size) return 0;
    int packed = *data++ != 0;
    size_t bytes = --size;
    options.format = SF_MODEL_SPZ;
    options.spz_frame = size % 2 ? SF_SPZ_FRAME_OWN : SF_SPZ_FRAME_RUB;
    const char *path = packed ? file_of(data, size, &bytes) : fuzz_file("in.spz", data, size);
    sf_context *ctx = fuzz_begin(bytes, BASE + (size_t)AS_MODEL * UNPACKED, 1 + (size_t)AS_MODEL * RATIO);
    int well = load(ctx, path, &options);
    fuzz_end();
    return well;
}

/* The files of a .sog, of 4 Gaussians with band 1, where libwebp is there to make them. */
enum { PARTS = 8 };
static struct {
    const char *name;
    const uint8_t *data;
    size_t size;
} parts[PARTS];

#ifdef SF_HAVE_LIBWEBP
#include <webp/encode.h>

static const char sog_meta[] =
    "{\"version\":2,\"count\":4,\"model\":\"antialiased\",\"means\":{\"mins\":[-1,-2,0],\"maxs\":[1,2,2],"
    "\"files\":[\"0\",\"1\"]},\"scales\":{\"codebook\":[-3,-2,0.5],\"files\":[\"2\"]},\"quats\":{\"files\":["
    "\"3\"]},"
    "\"sh0\":{\"codebook\":[-3,0.5],\"files\":[\"4\"]},\"shN\":{\"count\":64,\"bands\":1,\"codebook\":[-1,0."
    "25],"
    "\"files\":[\"5\",\"6\"]}}";

static void make_parts(void) {
    static const char *const names[] = {"0", "1", "2", "3", "4", "5", "6"};
    static uint8_t rgba[4 * 192];
    if (parts[0].name) return;
    for (int i = 0; i < (int)sizeof rgba; i++) rgba[i] = (uint8_t)(i % 4 == 3 ? 253 : 7 * i);
    for (int p = 0; p < PARTS - 1; p++) {
        uint8_t *data = NULL;
        int width = p == 5 ? 192 : 4;
        parts[p].size = WebPEncodeLosslessRGBA(rgba, width, 1, 4 * width, &data);
        FUZZ_CHECK(parts[p].size, "WebP: out of memory");
        parts[p].name = names[p];
        parts[p].data = data; /* until the end */
    }
    parts[PARTS - 1].name = "meta.json";
    parts[PARTS - 1].data = (const uint8_t *)sog_meta;
    parts[PARTS - 1].size = sizeof sog_meta - 1;
}
#else
static void make_parts(void) {}
#endif

/* All files, one of them replaced. */
static const char *make_sog(sf_context *ctx, int replaced, const uint8_t *data, size_t size) {
    const char *path = fuzz_path("in.sog");
    sf_writer w;
    sf_zip_writer zip = {.w = &w};
    FUZZ_CHECK(!sf_writer_open(&w, ctx, path), "%s", sf_last_error(ctx));
    for (int p = 0; p < PARTS && parts[p].name; p++)
        FUZZ_CHECK(!sf_zip_put(&zip, parts[p].name, p == replaced ? data : parts[p].data,
                               p == replaced ? size : parts[p].size),
                   "%s", sf_last_error(ctx));
    sf_zip_end(&zip);
    FUZZ_CHECK(!sf_writer_commit(&w), "%s", sf_last_error(ctx));
    return path;
}

/* The first byte: which file of a .sog the others are, or, from PARTS on, that they are all of it. What is
 * unpacked of an archive is 1,032 times as large; JSON takes a hundred times its text, and a file may have
 * 65,536 Gaussians, or 200 times its bytes. A model is held twice. */
int fuzz_sog(const uint8_t *data, size_t size) {
    enum { UNPACKED = 1032, AS_JSON = 128, FREE = 1 << 16, RATIO = 200, GAUSSIAN = 2 * 236 };
    sf_model_file_options options = sf_model_file_options_default();
    if (!size) return 0;
    int replaced = *data++;
    options.format = SF_MODEL_SOG;
    make_parts();
    sf_context *ctx = fuzz_begin(size, BASE + (size_t)FREE * GAUSSIAN,
                                 (size_t)UNPACKED * AS_JSON + (size_t)RATIO * GAUSSIAN);
    const char *path =
        replaced < PARTS ? make_sog(ctx, replaced, data, size - 1) : fuzz_file("in.sog", data, size - 1);
    /* A meta.json names files beside it, which are missing. */
    int well = load_parts(ctx, path, fuzz_path(""), &options);
    fuzz_end();
    return well;
}
