/* picture.c - pictures read: JPEG through TurboJPEG, PNG through libspng. */
#include "picture.h"

#include "../base/bytes.h"
#include "../base/file.h"

#include <errno.h>
#include <spng.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>
#include <unistd.h>

enum {
    PREFIX_BYTES = 1 << 16,    /* holds the header of nearly every picture */
    PNG_CHUNK_LIMIT = 1 << 26, /* bytes that a chunk besides the pixels may unpack to */
    EXIF_ORIENTATION = 0x0112, /* a tag of TIFF's first directory */
    TIFF_ENTRY_BYTES = 12,
    TIFF_SHORT = 3
};

static const uint64_t MAX_FILE_BYTES = (uint64_t)1 << 31;

static sf_status fault(sf_picture *p, sf_status status, const char *format, ...) SF_PRINTF(3, 4);

static sf_status fault(sf_picture *p, sf_status status, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(p->fault, sizeof p->fault, format, arguments);
    va_end(arguments);
    return status;
}

static sf_status set_size(sf_picture *p, uint32_t width, uint32_t height) {
    if (width == 0 || height == 0)
        return fault(p, SF_ERR_FORMAT, "size: %lu x %lu holds no pixel", (unsigned long)width,
                     (unsigned long)height);
    if (width > SF_PICTURE_MAX_SIDE || height > SF_PICTURE_MAX_SIDE ||
        (uint64_t)width * height > SF_PICTURE_MAX_PIXELS)
        return fault(p, SF_ERR_UNSUPPORTED, "size: %lu x %lu is more than %d a side or %d pixels",
                     (unsigned long)width, (unsigned long)height, SF_PICTURE_MAX_SIDE, SF_PICTURE_MAX_PIXELS);
    p->width = p->file_width = (int)width;
    p->height = p->file_height = (int)height;
    p->divided = 1;
    return SF_OK;
}

static size_t pixel_count(const sf_picture *p) { return (size_t)p->width * (size_t)p->height; }

static sf_status take_planes(sf_context *ctx, sf_picture *p, const uint8_t *pixels, int channels) {
    size_t n = pixel_count(p);
    p->rgb = sf_alloc(ctx, n, 3);
    if (!p->rgb) return fault(p, SF_ERR_MEMORY, "out of memory");
    uint8_t *red = p->rgb, *green = red + n, *blue = green + n;
    for (size_t i = 0; i < n; i++, pixels += channels)
        red[i] = pixels[0], green[i] = pixels[1], blue[i] = pixels[2];
    return SF_OK;
}

static sf_status take_weight(sf_context *ctx, sf_picture *p, const uint8_t *rgba) {
    size_t n = pixel_count(p), i = 0;
    while (i < n && rgba[4 * i + 3] == 255) i++;
    if (i == n) return SF_OK;
    p->weight = sf_alloc(ctx, n, 1);
    if (!p->weight) return fault(p, SF_ERR_MEMORY, "out of memory");
    for (i = 0; i < n; i++) p->weight[i] = rgba[4 * i + 3];
    return SF_OK;
}

/* JPEG. */

typedef struct segment {
    int marker;
    const uint8_t *data;
    size_t size;
} segment;

static unsigned big16(const uint8_t *p) { return (unsigned)p[0] << 8 | p[1]; }

static uint32_t big32(const uint8_t *p) { return (uint32_t)big16(p) << 16 | big16(p + 2); }

/* The start of the picture, restarts, and one of arithmetic coding: of two bytes, without a segment. */
static int is_marker_alone(int marker) { return (marker >= 0xd0 && marker <= 0xd8) || marker == 0x01; }

/* The next marker segment before the coded pixels; 0 where there is none. As libjpeg reads them, which takes
 * a length below its own two bytes as these. */
static int next_segment(sf_bytes *b, segment *s) {
    int marker;
    do {
        if (sf_bytes_u8(b) != 0xff) return 0;
        do marker = sf_bytes_u8(b);
        while (marker == 0xff); /* padding */
    } while (is_marker_alone(marker));
    if (marker == 0xda || marker == 0xd9) return 0;
    const uint8_t *length = sf_bytes_take(b, 2);
    if (!length) return 0;
    s->marker = marker;
    s->size = big16(length) < 2 ? 0 : big16(length) - 2;
    s->data = sf_bytes_take(b, s->size);
    return s->data != NULL;
}

static int is_frame_header(const segment *s) {
    return s->marker >= 0xc0 && s->marker <= 0xcf && s->marker != 0xc4 && s->marker != 0xc8 &&
           s->marker != 0xcc && s->size >= 5;
}

typedef struct tiff {
    const uint8_t *data;
    uint64_t size;
    int big_endian;
} tiff;

/* 0 outside of the data. */
static unsigned tiff16(const tiff *t, uint64_t at) {
    if (at + 2 > t->size) return 0;
    const uint8_t *p = t->data + at;
    return t->big_endian ? big16(p) : (unsigned)p[1] << 8 | p[0];
}

static uint32_t tiff32(const tiff *t, uint64_t at) {
    uint32_t first = tiff16(t, at), second = tiff16(t, at + 2);
    return t->big_endian ? first << 16 | second : second << 16 | first;
}

static int exif_orientation(const segment *s) {
    if (s->marker != 0xe1 || s->size < 14 || memcmp(s->data, "Exif\0", 6) != 0) return 1;
    tiff t = {s->data + 6, s->size - 6, s->data[6] == 'M'};
    uint64_t directory = tiff32(&t, 4);
    unsigned entries = tiff16(&t, directory);
    for (unsigned i = 0; i < entries; i++) {
        uint64_t entry = directory + 2 + (uint64_t)i * TIFF_ENTRY_BYTES;
        if (tiff16(&t, entry) != EXIF_ORIENTATION || tiff16(&t, entry + 2) != TIFF_SHORT) continue;
        unsigned value = tiff16(&t, entry + 8);
        return value >= 1 && value <= 8 ? (int)value : 1;
    }
    return 1;
}

static int jpeg_orientation(const uint8_t *data, size_t size) {
    sf_bytes b = {.data = data, .size = size};
    segment s;
    while (next_segment(&b, &s)) {
        int orientation = exif_orientation(&s);
        if (orientation != 1) return orientation;
    }
    return 1;
}

/* Pairs FF DA: of scans, and maybe some of thumbnails. */
static size_t count_scans(const uint8_t *data, size_t size) {
    size_t scans = 0;
    const uint8_t *end = data + size;
    while ((data = memchr(data, 0xff, (size_t)(end - data)))) scans += ++data < end && *data == 0xda;
    return scans;
}

int sf_jpeg_can_hold(const uint8_t *data, size_t size, int width, int height) {
    enum { PASSES = 32 }; /* over every pixel; encoders make 10 */
    uint64_t pixels = (uint64_t)width * (uint64_t)height, most = (uint64_t)size * SF_JPEG_PIXELS_A_BYTE;
    return pixels <= most && pixels * count_scans(data, size) / PASSES <= most;
}

static sf_status jpeg_header(tjhandle jpeg, const uint8_t *data, size_t size, sf_picture *p) {
    /* A file of tables alone, or cut before its size, is an error to newer libjpeg-turbos alone. */
    int width = 0, height = 0, sampling = -1, space = -1;
    if (tjDecompressHeader3(jpeg, data, (unsigned long)size, &width, &height, &sampling, &space))
        return fault(p, SF_ERR_FORMAT, "JPEG: %s", tjGetErrorStr2(jpeg));
    if (width < 1 || height < 1) return fault(p, SF_ERR_FORMAT, "JPEG: holds no picture");
    if (space == TJCS_CMYK || space == TJCS_YCCK)
        return fault(p, SF_ERR_UNSUPPORTED, "JPEG: colours: %s is not supported",
                     space == TJCS_CMYK ? "CMYK" : "YCCK (CMYK)");
    sf_status status = set_size(p, (uint32_t)width, (uint32_t)height);
    if (status || sf_jpeg_can_hold(data, size, width, height)) return status;
    return fault(p, SF_ERR_FORMAT, "JPEG: size: %d x %d is more than its %zu bytes can hold", width, height,
                 size);
}

/* By what the caller divides a picture's sides: by `factor`, or, where that is 0, by the least that makes
 * none longer than `side`. */
typedef struct reduction {
    int factor, side;
} reduction;

static const reduction full_size = {.factor = 1};

/* Decoding divides sides by powers of 2. */
static void reduce_by(sf_picture *p, reduction r) {
    int longer = p->width > p->height ? p->width : p->height;
    int factor = r.factor ? r.factor : (longer - 1) / r.side + 1;
    while (p->divided < 8 && factor % (2 * p->divided) == 0) p->divided *= 2;
    tjscalingfactor scale = {1, p->divided};
    p->width = TJSCALED(p->file_width, scale), p->height = TJSCALED(p->file_height, scale);
}

static sf_status jpeg_pixels(sf_context *ctx, tjhandle jpeg, const uint8_t *data, size_t size, reduction by,
                             sf_picture *p) {
    sf_status status = jpeg_header(jpeg, data, size, p);
    if (status) return status;
    reduce_by(p, by);
    uint8_t *pixels = sf_alloc(ctx, pixel_count(p), 3);
    if (!pixels) return fault(p, SF_ERR_MEMORY, "out of memory");
    /* A file that was cut off decodes with a warning, its rest grey: a warning is a failure here. */
    if (tjDecompress2(jpeg, data, (unsigned long)size, pixels, p->width, 0, p->height, TJPF_RGB,
                      TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS))
        status = fault(p, SF_ERR_FORMAT, "JPEG: %s", tjGetErrorStr2(jpeg));
    else
        status = take_planes(ctx, p, pixels, 3);
    sf_free(ctx, pixels);
    return status;
}

static sf_status load_jpeg(sf_context *ctx, const uint8_t *data, size_t size, reduction by, sf_picture *p) {
    tjhandle jpeg = tjInitDecompress();
    if (!jpeg) return fault(p, SF_ERR_MEMORY, "out of memory");
    p->orientation = jpeg_orientation(data, size);
    sf_status status = jpeg_pixels(ctx, jpeg, data, size, by, p);
    tjDestroy(jpeg);
    return status;
}

/* PNG. */

static sf_status png_fault(sf_picture *p, int error) {
    return fault(p, error == SPNG_EMEM ? SF_ERR_MEMORY : SF_ERR_FORMAT, "PNG: %s", spng_strerror(error));
}

static int png_has_alpha(spng_ctx *png, const struct spng_ihdr *header) {
    struct spng_trns transparency;
    return header->color_type == SPNG_COLOR_TYPE_GRAYSCALE_ALPHA ||
           header->color_type == SPNG_COLOR_TYPE_TRUECOLOR_ALPHA || !spng_get_trns(png, &transparency);
}

static sf_status png_pixels(sf_context *ctx, spng_ctx *png, int alpha, sf_picture *p) {
    int channels = alpha ? 4 : 3;
    size_t size = pixel_count(p) * (size_t)channels;
    uint8_t *pixels = sf_alloc(ctx, size, 1);
    if (!pixels) return fault(p, SF_ERR_MEMORY, "out of memory");
    int error =
        spng_decode_image(png, pixels, size, alpha ? SPNG_FMT_RGBA8 : SPNG_FMT_RGB8, SPNG_DECODE_TRNS);
    sf_status status = error ? png_fault(p, error) : take_planes(ctx, p, pixels, channels);
    if (!status && alpha) status = take_weight(ctx, p, pixels);
    sf_free(ctx, pixels);
    return status;
}

static sf_status png_size(const uint8_t *data, size_t size, sf_picture *p) {
    if (size < 24) return fault(p, SF_ERR_FORMAT, "PNG: ends within its header");
    return set_size(p, big32(data + 16), big32(data + 20));
}

static sf_status png_image(sf_context *ctx, spng_ctx *png, const uint8_t *data, size_t size, sf_picture *p) {
    struct spng_ihdr header;
    int error = spng_set_chunk_limits(png, PNG_CHUNK_LIMIT, PNG_CHUNK_LIMIT);
    if (!error) error = spng_set_png_buffer(png, data, size);
    if (!error) error = spng_get_ihdr(png, &header);
    if (error) return png_fault(p, error);
    return png_pixels(ctx, png, png_has_alpha(png, &header), p);
}

static sf_status check_png_pixels(sf_picture *p, size_t size) {
    if (pixel_count(p) <= SF_PNG_PIXELS || pixel_count(p) / SF_PNG_PIXELS_A_BYTE <= size) return SF_OK;
    return fault(p, SF_ERR_FORMAT, "PNG: size: %d x %d is more than its %zu bytes can hold", p->width,
                 p->height, size);
}

static sf_status load_png(sf_context *ctx, const uint8_t *data, size_t size, sf_picture *p) {
    sf_status status = png_size(data, size, p);
    if (!status) status = check_png_pixels(p, size);
    if (status) return status;
    spng_ctx *png = spng_ctx_new(0);
    if (!png) return fault(p, SF_ERR_MEMORY, "out of memory");
    status = png_image(ctx, png, data, size, p);
    spng_ctx_free(png);
    return status;
}

/* Both. */

static int is_jpeg(const uint8_t *data, size_t size) { return size >= 3 && !memcmp(data, "\xff\xd8\xff", 3); }

static int is_png(const uint8_t *data, size_t size) {
    return size >= 8 && !memcmp(data, "\x89PNG\r\n\x1a\n", 8);
}

/* Kinds that are known by their first bytes, to be named. */
static const char *other_kind(const uint8_t *data, size_t size) {
    static const struct {
        const char *name;
        size_t at, length;
        const char *bytes;
    } kinds[] = {{"WebP", 8, 4, "WEBP"},      {"HEIC or AVIF", 4, 4, "ftyp"}, {"TIFF", 0, 4, "II*\0"},
                 {"TIFF", 0, 4, "MM\0*"},     {"GIF", 0, 4, "GIF8"},          {"BMP", 0, 2, "BM"},
                 {"JPEG 2000", 4, 4, "jP  "}, {"JPEG XL", 4, 4, "JXL "},      {"OpenEXR", 0, 4, "v/1\1"}};
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (size >= kinds[i].at + kinds[i].length &&
            !memcmp(data + kinds[i].at, kinds[i].bytes, kinds[i].length))
            return kinds[i].name;
    return NULL;
}

static sf_status unknown_kind(sf_picture *p, const uint8_t *data, size_t size) {
    const char *kind = other_kind(data, size);
    if (kind) return fault(p, SF_ERR_UNSUPPORTED, "is %s: only JPEG and PNG are read", kind);
    return fault(p, SF_ERR_FORMAT, size ? "is neither a JPEG nor a PNG picture" : "is empty");
}

static sf_status load(sf_context *ctx, const uint8_t *data, size_t size, reduction by, sf_picture *p) {
    if (is_jpeg(data, size)) return load_jpeg(ctx, data, size, by, p);
    if (is_png(data, size)) return load_png(ctx, data, size, p);
    return unknown_kind(p, data, size);
}

/* The reason in a few words of why sf_read_file failed. */
static sf_status unreadable(sf_picture *p, const char *path, sf_status status) {
    if (status == SF_ERR_MEMORY) return fault(p, status, "out of memory");
    return fault(p, status, "%s", access(path, R_OK) ? strerror(errno) : "cannot be read as a file");
}

void sf_picture_free(sf_context *ctx, sf_picture *picture) {
    sf_free(ctx, picture->rgb);
    sf_free(ctx, picture->weight);
    picture->rgb = picture->weight = NULL;
}

static sf_status load_file(sf_context *ctx, const char *path, reduction by, sf_picture *picture) {
    *picture = (sf_picture){.orientation = 1};
    uint8_t *data;
    size_t size;
    sf_status status = sf_read_file(ctx, path, MAX_FILE_BYTES, &data, &size);
    if (status) return unreadable(picture, path, status);
    status = load(ctx, data, size, by, picture);
    sf_free(ctx, data);
    if (!status) return SF_OK;
    sf_picture_free(ctx, picture);
    return sf_fail(ctx, status, "%s: %s", path, picture->fault);
}

sf_status sf_picture_load(sf_context *ctx, const char *path, sf_picture *picture) {
    return load_file(ctx, path, full_size, picture);
}

sf_status sf_picture_load_reduced(sf_context *ctx, const char *path, int side, sf_picture *picture) {
    return load_file(ctx, path, (reduction){.side = side}, picture);
}

sf_status sf_picture_load_divided(sf_context *ctx, const char *path, int factor, sf_picture *picture) {
    return load_file(ctx, path, (reduction){.factor = factor}, picture);
}

/* Whether a PNG states transparent pixels: by its kind of colour, or in a chunk before its pixels. */
static sf_status png_header(const uint8_t *data, size_t size, sf_picture *p) {
    enum { KIND_AT = 25, CHUNKS_AT = 8, WITH_ALPHA = 4 /* a bit of the kind */ };
    sf_status status = png_size(data, size, p);
    p->has_alpha = !status && size > KIND_AT && data[KIND_AT] & WITH_ALPHA;
    for (uint64_t at = CHUNKS_AT; !status && !p->has_alpha;) {
        if (at + 8 > size) return fault(p, SF_ERR_FORMAT, "PNG: ends before its pixels");
        if (!memcmp(data + at + 4, "IDAT", 4)) break;
        p->has_alpha = !memcmp(data + at + 4, "tRNS", 4);
        at += 12 + (uint64_t)big32(data + at);
    }
    return status;
}

/* SF_ERR_FORMAT also where the header goes on beyond `size`. */
static sf_status read_header(const uint8_t *data, size_t size, sf_picture *p) {
    enum { COMPONENTS_AT = 5, INKS = 4 };
    if (is_png(data, size)) return png_header(data, size, p);
    if (!is_jpeg(data, size)) return unknown_kind(p, data, size);
    sf_bytes b = {.data = data, .size = size};
    segment s;
    while (next_segment(&b, &s)) {
        if (p->orientation == 1) p->orientation = exif_orientation(&s);
        if (!is_frame_header(&s)) continue;
        if (s.size > COMPONENTS_AT && s.data[COMPONENTS_AT] == INKS)
            return fault(p, SF_ERR_UNSUPPORTED, "JPEG: colours: CMYK is not supported");
        return set_size(p, big16(s.data + 3), big16(s.data + 1));
    }
    return fault(p, SF_ERR_FORMAT, "JPEG: no frame header");
}

static size_t read_prefix(const char *path, uint8_t *prefix) {
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    size_t size = fread(prefix, 1, PREFIX_BYTES, file);
    fclose(file);
    return size;
}

/* The sizes are those of what is decoded. */
static sf_status look(const uint8_t *data, size_t size, reduction by, sf_picture *p) {
    *p = (sf_picture){.orientation = 1};
    sf_status status = read_header(data, size, p);
    if (!status && is_jpeg(data, size)) reduce_by(p, by);
    return status;
}

static sf_status look_at_file(sf_context *ctx, const char *path, reduction by, sf_picture *p) {
    *p = (sf_picture){.orientation = 1};
    uint8_t *data = sf_alloc(ctx, PREFIX_BYTES, 1);
    if (!data) return fault(p, SF_ERR_MEMORY, "out of memory");
    sf_status status = look(data, read_prefix(path, data), by, p);
    sf_free(ctx, data);
    if (!status) return SF_OK;
    size_t size; /* a long header, or a fault to be named */
    status = sf_read_file(ctx, path, MAX_FILE_BYTES, &data, &size);
    if (status) return unreadable(p, path, status);
    status = look(data, size, by, p);
    sf_free(ctx, data);
    return status ? sf_fail(ctx, status, "%s: %s", path, p->fault) : SF_OK;
}

sf_status sf_picture_look(sf_context *ctx, const char *path, int factor, sf_picture *picture) {
    return look_at_file(ctx, path, (reduction){.factor = factor}, picture);
}

static sf_status size_of(sf_context *ctx, const char *path, reduction by, int *width, int *height) {
    sf_picture p;
    sf_status status = look_at_file(ctx, path, by, &p);
    if (status) return status;
    *width = p.width;
    *height = p.height;
    return SF_OK;
}

sf_status sf_picture_size_reduced(sf_context *ctx, const char *path, int side, int *width, int *height) {
    return size_of(ctx, path, (reduction){.side = side}, width, height);
}

sf_status sf_picture_size(sf_context *ctx, const char *path, int *width, int *height) {
    return size_of(ctx, path, full_size, width, height);
}
