/* frames.c - targets picture, exif, frames, pipe, source, y4m, jpeg_cut: pictures, and streams of them. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/query.h"
#include "capture/jpeg_cut.h"
#include "capture/y4m.h"
#include "fuzz.h"
#include "io/picture.h"
#include "sfm/exif.h"

/* A picture's planes, once more as they are decoded, and its weights: of as many pixels as the file may
 * hold. */
int fuzz_picture(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, (size_t)8 * SF_PNG_PIXELS + (1 << 18), 8 * SF_PNG_PIXELS_A_BYTE);
    const char *path = fuzz_file("picture", data, size);
    sf_picture picture;
    int width = 0, height = 0, named = !sf_picture_size(ctx, path, &width, &height);
    int well = fuzz_went_well(ctx, sf_picture_load(ctx, path, &picture), path);
    if (well)
        FUZZ_CHECK(named && width == picture.width && height == picture.height,
                   "picture: %d x %d, told from its header %d x %d", picture.width, picture.height, width,
                   height);
    sf_picture_free(ctx, &picture);
    fuzz_end();
    return well;
}

/* What a photo tells of its camera; libexif's memory is not counted. */
int fuzz_exif(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, 1 << 18, 8);
    sf_exif exif;
    (void)ctx;
    sf_exif_read(fuzz_file("exif", data, size), &exif);
    FUZZ_CHECK(memchr(exif.make, 0, sizeof exif.make) && memchr(exif.model, 0, sizeof exif.model),
               "exif: a text without an end");
    double focal = sf_exif_focal(&exif, 400, 300);
    FUZZ_CHECK(focal == 0 || (focal > 80 && focal < 16000), "exif: %g px", focal);
    FUZZ_CHECK(sf_exif_is_same(&exif, &exif), "exif: not the camera that it is");
    fuzz_end();
    return focal > 0;
}

/* A frame as floats, where it is small enough for the harness. */
static void convert(sf_context *ctx, const sf_frame *frame) {
    enum { MOST = 1 << 16 };
    size_t pixels = (size_t)frame->width * (size_t)frame->height;
    if (pixels > MOST) return;
    float *rgb = malloc(3 * pixels * sizeof *rgb);
    FUZZ_CHECK(rgb, "out of memory");
    float *const planes[3] = {rgb, rgb + pixels, rgb + 2 * pixels};
    fuzz_went_well(ctx, sf_frame_convert(ctx, frame, planes, (size_t)frame->width), "frame");
    free(rgb);
}

/* All frames of a source. */
static int drain(sf_context *ctx, const char *name) {
    enum { WAIT_MS = 2000, MOST_FRAMES = 50 };
    sf_source *source;
    sf_source_info info;
    sf_frame frame;
    sf_status status = sf_source_open(ctx, name, &source);
    size_t length = strcspn(name, "?");
    char file[512];
    const char *at = strchr(name, ':') + 1;
    snprintf(file, sizeof file, "%.*s", (int)(length - (size_t)(at - name)), at);
    if (!fuzz_went_well(ctx, status, file)) return 0;
    sf_source_describe(source, &info);
    for (int i = 0; i < MOST_FRAMES && !(status = sf_source_next(source, WAIT_MS, &frame)); i++) {
        convert(ctx, &frame);
        sf_source_release(source, &frame);
    }
    FUZZ_CHECK(status != SF_ERR_TIMEOUT, "%s: %s", name, sf_last_error(ctx));
    sf_source_close(&source);
    return 1;
}

/* The first byte: 0, the stream says what it is; else pixels of a size and a format. The stream's buffer is
 * 64 KiB; of each of 7 slots a frame is no more than half as large again as what came, and a JPEG's pixels
 * are up to 512 a byte. */
int fuzz_pipe(const uint8_t *data, size_t size) {
    static const char *const matrices[] = {"601", "709", "2020"};
    char name[600], options[96] = "";
    sf_bytes input = {.data = data, .size = size};
    unsigned kind = sf_bytes_u8(&input);
    if (kind) {
        unsigned width = sf_bytes_u8(&input), height = sf_bytes_u8(&input);
        const char *format = sf_pixel_format_name((sf_pixel_format)(kind % (SF_PIXEL_FORMATS + 1)));
        snprintf(options, sizeof options, "?size=%ux%u&format=%s&matrix=%s&range=%s", width, height,
                 format ? format : "none", matrices[kind / 16 % 3], kind & 64 ? "full" : "limited");
    }
    sf_bytes stream = fuzz_rest(&input);
    sf_context *ctx = fuzz_begin(size, 8 << 20, 3 * SF_JPEG_PIXELS_A_BYTE + 16);
    snprintf(name, sizeof name, "pipe:%s%s", fuzz_file("stream", stream.data, stream.size), options);
    int well = drain(ctx, name);
    fuzz_end();
    return well;
}

int fuzz_frames(const uint8_t *data, size_t size) {
    static const float rgb[4 * 3 * 3] = {0.5f, [20] = 1};
    static const char *const options[] = {"", "?decode=0", "?loop=1&fps=1000", "?fps=1000"};
    char name[600];
    uint8_t *jpeg;
    size_t bytes;
    sf_context *ctx = fuzz_begin(size, 1 << 20, 128);
    fuzz_subfolder("frames");
    FUZZ_CHECK(!sf_encode_jpeg(ctx, 4, 3, rgb, 90, &jpeg, &bytes), "no JPEG");
    fuzz_file("frames/a.jpg", jpeg, bytes);
    fuzz_file("frames/b.png", "no picture", 10);
    fuzz_file("frames/frames.json", data, size);
    sf_encoded_free(ctx, &jpeg);
    snprintf(name, sizeof name, "folder:%s%s", fuzz_path("frames"), options[size % 2]);
    int well = drain(ctx, name);
    fuzz_end();
    return well;
}

/* What stands behind a source's "?". */
int fuzz_source(const uint8_t *data, size_t size) {
    enum { MOST = 4096 };
    char name[MOST + 16], text[32] = "";
    sf_query_option options[] = {{.name = "fps", .most = 1000},
                                 {.name = "loop", .most = 1, .whole = 1},
                                 {.name = "count", .least = -1e18, .most = 1e18, .whole = 1},
                                 {.name = "size", .text = text, .text_size = sizeof text},
                                 {.name = "ctrl."}};
    snprintf(name, sizeof name, "pipe:x?%.*s", size < MOST ? (int)size : MOST, (const char *)data);
    sf_context *ctx = fuzz_begin(size, 1 << 18, 1);
    int well = fuzz_went_well(ctx, sf_query_parse(ctx, name, options, 5), "pipe:x");
    fuzz_end();
    return well;
}

int fuzz_y4m(const uint8_t *data, size_t size) {
    enum { MOST = 1024 };
    char line[MOST + 16], fault[192];
    sf_y4m header;
    snprintf(line, sizeof line, SF_Y4M_MAGIC "%.*s", size < MOST ? (int)size : MOST, (const char *)data);
    if (sf_y4m_parse(line, &header, fault, sizeof fault)) {
        FUZZ_CHECK(*fault, "y4m: no fault is named");
        return 0;
    }
    FUZZ_CHECK(header.width >= 1 && header.height >= 1 && header.fps >= 0, "y4m: %d x %d, %g", header.width,
               header.height, header.fps);
    return 1;
}

/* Events at the same places, however the stream is cut into calls. */
static uint64_t cut(const uint8_t *data, size_t size, size_t piece, int *whole) {
    sf_jpeg_cutter cutter = {0};
    uint64_t events = 0;
    for (size_t at = 0; at < size;) {
        size_t taken = 0;
        sf_jpeg_event event = sf_jpeg_cut(&cutter, data + at, size - at < piece ? size - at : piece, &taken);
        FUZZ_CHECK(taken <= piece && taken <= size - at, "jpeg_cut: %zu bytes taken", taken);
        FUZZ_CHECK(taken || event != SF_JPEG_MORE, "jpeg_cut: stands still at %zu", at);
        at += taken;
        if (event == SF_JPEG_MORE) continue;
        events = (events ^ (at << 2 | (unsigned)event)) * 0x9e3779b97f4a7c15u;
        if (event != SF_JPEG_WHOLE) continue;
        *whole = 1;
        FUZZ_CHECK(cutter.width > 0 && cutter.height > 0, "jpeg_cut: %d x %d", cutter.width, cutter.height);
    }
    return events;
}

int fuzz_jpeg_cut(const uint8_t *data, size_t size) {
    enum { MOST = 4096 };
    int whole = 0;
    if (size > MOST) size = MOST;
    int32_t width, height;
    uint64_t events = cut(data, size, size, &whole);
    FUZZ_CHECK(cut(data, size, 1, &whole) == events && cut(data, size, 7, &whole) == events,
               "jpeg_cut: other events where the stream comes in pieces");
    if (sf_jpeg_size(data, size, &width, &height))
        FUZZ_CHECK(width > 0 && height > 0, "jpeg_cut: %d x %d", width, height);
    return whole;
}
