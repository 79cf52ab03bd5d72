/* inputs_fixture.c - writes pictures, masks, and the files of COLMAP, transforms.json, OpenSfM and archives.
 */
#include "inputs_fixture.h"

#include <math.h>
#include <spng.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <turbojpeg.h>
#include <zlib.h>

const double inputs_fx = 20, inputs_fy = 21, inputs_cx = PX + 0.5, inputs_cy = PY + 0.5;
const double inputs_translations[VIEWS][3] = {{0, 0, 3}, {0.25, -0.5, 3}, {0.5, 1, 2.5}};
const char *const inputs_names[VIEWS] = {"a", "b", "c"};

static double turn_of(int view) { return view * 3.14159265358979323846 / 6; }

void inputs_rotation_of(int view, double R[9]) {
    double c = cos(turn_of(view)), s = sin(turn_of(view));
    double rows[9] = {c, 0, s, 0, 1, 0, -s, 0, c};
    memcpy(R, rows, sizeof rows);
}

uint8_t inputs_shade(int view, int x, int y, int channel) {
    return (uint8_t)(20 + 60 * view + 5 * x + 3 * y + 10 * channel);
}

/* Files. */

static void make_folders(const char *project, const char *name) {
    char part[512];
    snprintf(part, sizeof part, "%s/%s", project, name);
    for (char *c = part; *c; c++) {
        if (*c != '/') continue;
        *c = 0;
        mkdir(test_path(part), 0777);
        *c = '/';
    }
}

static void put(const char *project, const char *name, const void *data, size_t size) {
    make_folders(project, name);
    test_write(test_path_in(project, name), data, size);
}

int inputs_marked; /* texts begin with a byte order mark */

void inputs_put_text(const char *project, const char *name, const char *text) {
    char plain[TEXT];
    size_t size = strlen(text), json = strstr(name, ".json") != NULL;
    size_t mark = inputs_marked ? 3 : 0;
    assert_true(mark + size < sizeof plain);
    if (mark) memcpy(plain, "\xEF\xBB\xBF", mark);
    for (size_t i = 0; i < size; i++) plain[mark + i] = text[i] == '\'' && json ? '"' : text[i];
    put(project, name, plain, mark + size);
}

static void append(char *text, const char *format, ...) {
    size_t used = strlen(text);
    va_list args;
    va_start(args, format);
    int n = vsnprintf(text + used, TEXT - used, format, args);
    va_end(args);
    assert_true(n >= 0 && (size_t)n < TEXT - used);
}

/* Pictures. */

void inputs_put_png(const char *project, const char *name, int view, int divisor, kind k) {
    size_t width = (size_t)(WIDTH / divisor), height = (size_t)(HEIGHT / divisor), at = 0, size;
    uint8_t pixels[WIDTH * HEIGHT * 8];
    struct spng_plte palette = {.n_entries = 256};
    for (size_t i = 0; i < width * height; i++) {
        int x = (int)(i % width) * divisor, y = (int)(i / width) * divisor;
        if (k == PALETTE) palette.entries[i % 256].red = inputs_shade(view, x, y, 0);
        if (k == PALETTE) palette.entries[i % 256].green = inputs_shade(view, x, y, 1);
        if (k == PALETTE) palette.entries[i % 256].blue = inputs_shade(view, x, y, 2);
        if (k == PALETTE) pixels[at++] = (uint8_t)i;
        for (int c = 0; c < (k == PALETTE ? 0 : k == GREY ? 1 : 3); c++) {
            pixels[at++] = inputs_shade(view, x, y, c);
            if (k == DEEP) pixels[at++] = 7; /* the lower byte of 16 bits */
        }
        if (k == ALPHA) pixels[at++] = x < PX ? 255 : 0;
    }
    struct spng_ihdr header = {.width = (uint32_t)width, .height = (uint32_t)height, .bit_depth = 8};
    header.bit_depth = k == DEEP ? 16 : 8;
    header.color_type = k == GREY      ? SPNG_COLOR_TYPE_GRAYSCALE
                        : k == PALETTE ? SPNG_COLOR_TYPE_INDEXED
                        : k == ALPHA   ? SPNG_COLOR_TYPE_TRUECOLOR_ALPHA
                                       : SPNG_COLOR_TYPE_TRUECOLOR;
    header.interlace_method = k == INTERLACED ? SPNG_INTERLACE_ADAM7 : SPNG_INTERLACE_NONE;
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    assert_int_equal(spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1), 0);
    assert_int_equal(spng_set_ihdr(png, &header), 0);
    if (k == PALETTE) assert_int_equal(spng_set_plte(png, &palette), 0);
    assert_int_equal(
        spng_encode_image(png, pixels, at, k == DEEP ? SPNG_FMT_RAW : SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
    int error;
    void *file = spng_get_png_buffer(png, &size, &error);
    assert_non_null(file);
    put(project, name, file, size);
    free(file);
    spng_ctx_free(png);
}

/* Of one colour, that of (PX, PY), so that the coding changes nothing. */
static void put_jpeg(const char *project, const char *name, int view, kind k) {
    uint8_t pixels[WIDTH * HEIGHT * 4];
    int channels = k == CMYK_JPEG ? 4 : k == GREY_JPEG ? 1 : 3;
    for (int i = 0; i < WIDTH * HEIGHT * channels; i++)
        pixels[i] = k == CMYK_JPEG ? 77 : inputs_shade(view, PX, PY, i % channels);
    unsigned char *file = NULL;
    unsigned long size = 0;
    tjhandle jpeg = tjInitCompress();
    int format = k == CMYK_JPEG ? TJPF_CMYK : k == GREY_JPEG ? TJPF_GRAY : TJPF_RGB;
    int sampling = k == GREY_JPEG ? TJSAMP_GRAY : TJSAMP_444;
    assert_int_equal(tjCompress2(jpeg, pixels, WIDTH, 0, HEIGHT, format, &file, &size, sampling, 100,
                                 k == PROGRESSIVE ? TJFLAG_PROGRESSIVE : 0),
                     0);
    if (k == TURNED_JPEG) {
        static const uint8_t exif[] = "\xff\xe1\0\x22"
                                      "Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0";
        uint8_t turned[8192];
        const size_t segment = 36;
        assert_true(size + segment < sizeof turned);
        memcpy(turned, file, 2);
        memcpy(turned + 2, exif, segment);
        memcpy(turned + 2 + segment, file + 2, size - 2);
        put(project, name, turned, size + segment);
    } else {
        put(project, name, file, size);
    }
    tjFree(file);
    tjDestroy(jpeg);
}

static void put_picture(const char *project, const char *name, int view, kind k) {
    if (k < JPEG)
        inputs_put_png(project, name, view, 1, k);
    else
        put_jpeg(project, name, view, k);
}

void inputs_put_pictures(const char *project, const char *folder, const char *ending, kind k) {
    for (int v = 0; v < VIEWS; v++) {
        char name[256];
        snprintf(name, sizeof name, "%s/%s%s", folder, inputs_names[v], ending);
        put_picture(project, name, v, k);
    }
}

static void put_small(const char *project, const char *folder, int divisor) {
    for (int v = 0; v < VIEWS; v++) {
        char name[256];
        snprintf(name, sizeof name, "%s/%s.png", folder, inputs_names[v]);
        inputs_put_png(project, name, v, divisor, RGB);
    }
}

void inputs_put_mask_of(const char *project, const char *name, int divisor, int white) {
    float rgb[3 * WIDTH * HEIGHT];
    int width = WIDTH / divisor, height = HEIGHT / divisor;
    for (int i = 0; i < width * height; i++) {
        int near = abs(i % width * divisor - PX) <= 2 && abs(i / width * divisor - PY) <= 2;
        for (int c = 0; c < 3; c++) rgb[3 * i + c] = near ? 0 : (float)white / 255;
    }
    sf_context *ctx = test_context();
    make_folders(project, name);
    assert_ok(ctx, sf_write_png(ctx, test_path_in(project, name), width, height, rgb));
    sf_context_destroy(&ctx);
}

void inputs_put_mask(const char *project, const char *name, int divisor) {
    inputs_put_mask_of(project, name, divisor, 255);
}

/* COLMAP. */

const char inputs_pinhole[] = "PINHOLE 24 16 20 21 12.5 8.5";
static const char two_points[] = "1 1 2 3 10 20 30 0.5\n2 -1 0 2 40 50 60 0.5 1 0\n";

static void put_images_txt(const char *project, const char *folder, int first, int end, const char *form) {
    char text[TEXT] = "# Image list\n", path[256];
    for (int v = first; v < end; v++) {
        const double *t = inputs_translations[v], half = turn_of(v) / 2;
        append(text, "%d %.17g 0 %.17g 0 %.17g %.17g %.17g 1 ", v + 1, cos(half), sin(half), t[0], t[1],
               t[2]);
        append(text, form, inputs_names[v]);
        append(text, "\n\n");
    }
    snprintf(path, sizeof path, "%simages.txt", folder);
    inputs_put_text(project, path, text);
}

/* A model as text; the pictures' names are made of `form`. */
static void put_model(const char *project, const char *folder, const char *camera, int first, int end,
                      const char *form) {
    char text[TEXT] = "", path[256];
    append(text, "1 %s\n", camera);
    snprintf(path, sizeof path, "%scameras.txt", folder);
    inputs_put_text(project, path, text);
    snprintf(path, sizeof path, "%spoints3D.txt", folder);
    inputs_put_text(project, path, two_points);
    put_images_txt(project, folder, first, end, form);
}

void inputs_make_colmap(const char *project, const char *camera) {
    inputs_put_pictures(project, "images", ".png", RGB);
    put_model(project, "sparse/0/", camera, 0, VIEWS, "%s.png");
}

static void add_bytes(uint8_t *data, size_t *size, const void *from, size_t n) {
    memcpy(data + *size, from, n); /* this machine's bytes are little-endian, as all that are supported */
    *size += n;
}

static void add_u64(uint8_t *data, size_t *size, uint64_t value) { add_bytes(data, size, &value, 8); }
static void add_u32(uint8_t *data, size_t *size, uint32_t value) { add_bytes(data, size, &value, 4); }

void inputs_make_binary(const char *project, const char *rest) {
    uint8_t data[2048];
    size_t size = 0;
    const double parameters[] = {inputs_fx, inputs_fy, inputs_cx, inputs_cy};
    (void)rest;
    inputs_put_pictures(project, "images", ".png", RGB);
    add_u64(data, &size, 1);
    add_u32(data, &size, 1);
    add_u32(data, &size, 1);
    add_u64(data, &size, WIDTH);
    add_u64(data, &size, HEIGHT);
    add_bytes(data, &size, parameters, sizeof parameters);
    put(project, "sparse/0/cameras.bin", data, size);
    size = 0;
    add_u64(data, &size, VIEWS);
    for (int v = 0; v < VIEWS; v++) {
        const double pose[7] = {cos(turn_of(v) / 2),       0,
                                sin(turn_of(v) / 2),       0,
                                inputs_translations[v][0], inputs_translations[v][1],
                                inputs_translations[v][2]};
        char name[8];
        add_u32(data, &size, (uint32_t)v + 1);
        add_bytes(data, &size, pose, sizeof pose);
        add_u32(data, &size, 1);
        add_bytes(data, &size, name, (size_t)snprintf(name, sizeof name, "%s.png", inputs_names[v]) + 1);
        add_u64(data, &size, 0);
    }
    put(project, "sparse/0/images.bin", data, size);
    inputs_put_text(project, "sparse/0/points3D.txt", two_points);
    /* of newer versions, and not read */
    put(project, "sparse/0/rigs.bin", "\1\2\3", 3);
    put(project, "sparse/0/frames.bin", "\4\5\6", 3);
}

void inputs_make_flat(const char *project, const char *folder) {
    inputs_put_pictures(project, "images", ".png", RGB);
    put_model(project, folder, inputs_pinhole, 0, VIEWS, "%s.png");
}

void inputs_make_beside(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, ".", ".png", RGB);
    put_model(project, "", inputs_pinhole, 0, VIEWS, "%s.png");
}

void inputs_make_small(const char *project, const char *folder) {
    put_small(project, folder, 2);
    put_model(project, "sparse/0/", inputs_pinhole, 0, VIEWS, "%s.png");
}

void inputs_make_several(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, "images", ".png", RGB);
    put_model(project, "sparse/0/", inputs_pinhole, 1, 2, "%s.png");
    put_model(project, "sparse/1/", inputs_pinhole, 0, VIEWS, "%s.png");
}

void inputs_make_subfolders(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, "images/a room/left eye", ".png", RGB);
    put_model(project, "sparse/0/", inputs_pinhole, 0, VIEWS, "a room/left eye/%s.png");
}

void inputs_make_backslashes(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, "images/a room", ".png", RGB);
    put_model(project, "sparse/0/", inputs_pinhole, 0, VIEWS, "a room\\%s.png");
}

void inputs_make_marked_colmap(const char *project, const char *camera) {
    inputs_marked = 1;
    inputs_make_colmap(project, camera);
    inputs_marked = 0;
}

void inputs_make_missing(const char *project, const char *rest) {
    inputs_make_colmap(project, rest);
    assert_int_equal(remove(test_path_in(project, "images/c.png")), 0);
}

void inputs_make_masked(const char *project, const char *form) {
    inputs_make_colmap(project, inputs_pinhole);
    for (int v = 0; v < VIEWS; v++) {
        char name[256], path[300];
        snprintf(name, sizeof name, "%s.png", inputs_names[v]);
        snprintf(path, sizeof path, form, inputs_names[v]);
        inputs_put_mask(project, path, 1);
    }
}

void inputs_make_black_masks(const char *project, int hidden) {
    static const char *const files[] = {"masks/a.png", "masks/b.png", "masks/c.png"};
    inputs_make_colmap(project, inputs_pinhole);
    for (int v = 0; v < VIEWS; v++) inputs_put_mask_of(project, files[v], 1, v < hidden ? 0 : 255);
}

void inputs_make_kind(const char *project, kind k, const char *ending) {
    char form[16];
    snprintf(form, sizeof form, "%%s%s", ending);
    inputs_put_pictures(project, "images", ending, k);
    put_model(project, "sparse/0/", inputs_pinhole, 0, VIEWS, form);
}

/* transforms.json. */

static void add_matrix(char *text, int view) {
    double R[9];
    const double *t = inputs_translations[view];
    inputs_rotation_of(view, R);
    append(text, "'transform_matrix':[");
    for (int row = 0; row < 3; row++) {
        double centre = 0;
        for (int k = 0; k < 3; k++) centre -= R[3 * k + row] * t[k];
        append(text, "[%.17g,%.17g,%.17g,%.17g],", R[row], -R[3 + row], -R[6 + row], centre);
    }
    append(text, "[0,0,0,1]]");
}

void inputs_put_transforms(const char *project, const char *file, int first, int end, const char *head,
                           const char *frame) {
    char text[TEXT] = "";
    append(text, "%s'frames':[", head);
    for (int v = first; v < end; v++) {
        append(text, v > first ? ",{" : "{");
        append(text, frame, inputs_names[v], inputs_names[v], inputs_names[v]);
        add_matrix(text, v);
        append(text, "}");
    }
    append(text, "]}");
    inputs_put_text(project, file, text);
}

const char inputs_intrinsics[] = "{'w':24,'h':16,'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.5,";

void inputs_make_ngp(const char *project, const char *more) {
    char head[512];
    snprintf(head, sizeof head, "%s'aabb_scale':16,'scale':2,'offset':[1,2,3],%s", inputs_intrinsics, more);
    inputs_put_pictures(project, "images", ".png", RGB);
    put_small(project, "images_2", 2);
    inputs_put_transforms(project, "transforms.json", 0, VIEWS, head,
                          "'file_path':'./images/%s.png','sharpness':30,");
}

/* OpenSfM. */

void inputs_put_opensfm(const char *project, const char *file, const char *camera, int first, int end,
                        const char *form) {
    char text[TEXT] = "";
    append(text, "[{'cameras':{'v2 x':{'width':24,'height':16,%s}},'shots':{'odd':", camera);
    append(text, "{'rotation':[0,0,0],'translation':[0,0,0],'camera':'v2 x'}");
    append(text,
           "},'points':{}},{'cameras':{'v2 x':{'width':24,'height':16,%s}},'reference_lla':{},'shots':{",
           camera);
    for (int v = first; v < end; v++) {
        const double *t = inputs_translations[v];
        append(text, v > first ? ",'" : "'");
        append(text, form, inputs_names[v]);
        append(text,
               "':{'orientation':1,'rotation':[0,%.17g,0],'translation':[%.17g,%.17g,%.17g],'camera':'v2 x'}",
               turn_of(v), t[0], t[1], t[2]);
    }
    append(text, "},'points':{'7':{'color':[10,20,30],'coordinates':[1,2,3]},"
                 "'9':{'color':[40.0,50.0,60.0],'coordinates':[-1,0,2]}}}]");
    inputs_put_text(project, file, text);
}

void inputs_make_opensfm(const char *project, const char *camera) {
    inputs_put_pictures(project, "images", ".png", RGB);
    inputs_put_opensfm(project, "reconstruction.json", camera, 0, VIEWS, "%s.png");
}

/* Archives: stored, by hand. */

static void add_u16(uint8_t *data, size_t *size, unsigned value) {
    add_bytes(data, size, &(uint16_t){(uint16_t)value}, 2);
}

void inputs_add_entry(archive *a, const char *name, const uint8_t *data, size_t size, size_t claimed,
                      int method, unsigned attributes) {
    uint32_t crc = (uint32_t)crc32(0, data, (unsigned)size), at = (uint32_t)a->size;
    assert_true(a->size + size + 200 < sizeof a->data && a->directory_size + 200 < sizeof a->directory);
    for (int central = 0; central < 2; central++) {
        uint8_t *to = central ? a->directory : a->data;
        size_t *used = central ? &a->directory_size : &a->size;
        add_u32(to, used, central ? 0x02014b50 : 0x04034b50);
        if (central) add_u16(to, used, 3 << 8 | 20); /* by unix */
        add_u16(to, used, 20);
        add_u16(to, used, 0);
        add_u16(to, used, (unsigned)method);
        add_u32(to, used, 0x21 << 16);
        add_u32(to, used, crc);
        add_u32(to, used, (uint32_t)size);
        add_u32(to, used, (uint32_t)claimed);
        add_u16(to, used, (unsigned)strlen(name));
        add_u16(to, used, 0);
        if (central) {
            add_u16(to, used, 0);
            add_u16(to, used, 0);
            add_u16(to, used, 0);
            add_u32(to, used, attributes << 16);
            add_u32(to, used, at);
        }
        add_bytes(to, used, name, strlen(name));
        if (!central) add_bytes(to, used, data, size);
    }
    a->count++;
}

void inputs_put_archive(archive *a, const char *name) {
    uint32_t at = (uint32_t)a->size;
    add_bytes(a->data, &a->size, a->directory, a->directory_size);
    add_u32(a->data, &a->size, 0x06054b50);
    add_u32(a->data, &a->size, 0);
    add_u16(a->data, &a->size, a->count);
    add_u16(a->data, &a->size, a->count);
    add_u32(a->data, &a->size, (uint32_t)a->directory_size);
    add_u32(a->data, &a->size, at);
    add_u16(a->data, &a->size, 0);
    test_write(test_path(name), a->data, a->size);
}
