/* test_inputs.c - the projects that users have, one of each kind: a table of what must load, and of what is
 * refused by name. src/io/README.md has the same list.
 *
 * All show the same scene from the same three cameras: only how that is written down differs.
 */
#include "testing.h"

#include <dirent.h>
#include <math.h>
#include <spng.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <turbojpeg.h>
#include <zlib.h>

enum { WIDTH = 24, HEIGHT = 16, VIEWS = 3, TEXT = 16384 };

/* The scene: view k is turned by 30 k degrees about y and stands so that its t is this. The principal point
 * is the centre of pixel (PX, PY), where no lens distorts. */
enum { PX = 12, PY = 8 };
static const double fx = 20, fy = 21, cx = PX + 0.5, cy = PY + 0.5;
static const double translations[VIEWS][3] = {{0, 0, 3}, {0.25, -0.5, 3}, {0.5, 1, 2.5}};
static const char *const names[VIEWS] = {"a", "b", "c"};

static double turn_of(int view) { return view * 3.14159265358979323846 / 6; }

static void rotation_of(int view, double R[9]) {
    double c = cos(turn_of(view)), s = sin(turn_of(view));
    double rows[9] = {c, 0, s, 0, 1, 0, -s, 0, c};
    memcpy(R, rows, sizeof rows);
}

static uint8_t shade(int view, int x, int y, int channel) {
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

static int marked; /* texts begin with a byte order mark */

/* JSON is spelled with ' for ". */
static void put_text(const char *project, const char *name, const char *text) {
    char plain[TEXT];
    size_t size = strlen(text), json = strstr(name, ".json") != NULL;
    size_t mark = marked ? 3 : 0;
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

typedef enum kind {
    RGB,
    GREY,
    DEEP,
    PALETTE,
    INTERLACED,
    ALPHA, /* PNG */
    JPEG,
    PROGRESSIVE,
    GREY_JPEG,
    TURNED_JPEG,
    CMYK_JPEG
} kind;

/* With ALPHA: opaque in the left half, 0 from PX on. */
static void put_png(const char *project, const char *name, int view, int divisor, kind k) {
    size_t width = (size_t)(WIDTH / divisor), height = (size_t)(HEIGHT / divisor), at = 0, size;
    uint8_t pixels[WIDTH * HEIGHT * 8];
    struct spng_plte palette = {.n_entries = 256};
    for (size_t i = 0; i < width * height; i++) {
        int x = (int)(i % width) * divisor, y = (int)(i / width) * divisor;
        if (k == PALETTE) palette.entries[i % 256].red = shade(view, x, y, 0);
        if (k == PALETTE) palette.entries[i % 256].green = shade(view, x, y, 1);
        if (k == PALETTE) palette.entries[i % 256].blue = shade(view, x, y, 2);
        if (k == PALETTE) pixels[at++] = (uint8_t)i;
        for (int c = 0; c < (k == PALETTE ? 0 : k == GREY ? 1 : 3); c++) {
            pixels[at++] = shade(view, x, y, c);
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
        pixels[i] = k == CMYK_JPEG ? 77 : shade(view, PX, PY, i % channels);
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
        put_png(project, name, view, 1, k);
    else
        put_jpeg(project, name, view, k);
}

/* folder/a.png, b.png, c.png. */
static void put_pictures(const char *project, const char *folder, const char *ending, kind k) {
    for (int v = 0; v < VIEWS; v++) {
        char name[256];
        snprintf(name, sizeof name, "%s/%s%s", folder, names[v], ending);
        put_picture(project, name, v, k);
    }
}

static void put_small(const char *project, const char *folder, int divisor) {
    for (int v = 0; v < VIEWS; v++) {
        char name[256];
        snprintf(name, sizeof name, "%s/%s.png", folder, names[v]);
        put_png(project, name, v, divisor, RGB);
    }
}

/* Black at (PX, PY) and around it, else `white` of 255. */
static void put_mask_of(const char *project, const char *name, int divisor, int white) {
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

static void put_mask(const char *project, const char *name, int divisor) {
    put_mask_of(project, name, divisor, 255);
}

/* COLMAP. */

static const char pinhole[] = "PINHOLE 24 16 20 21 12.5 8.5";
static const char two_points[] = "1 1 2 3 10 20 30 0.5\n2 -1 0 2 40 50 60 0.5 1 0\n";

static void put_images_txt(const char *project, const char *folder, int first, int end, const char *form) {
    char text[TEXT] = "# Image list\n", path[256];
    for (int v = first; v < end; v++) {
        const double *t = translations[v], half = turn_of(v) / 2;
        append(text, "%d %.17g 0 %.17g 0 %.17g %.17g %.17g 1 ", v + 1, cos(half), sin(half), t[0], t[1],
               t[2]);
        append(text, form, names[v]);
        append(text, "\n\n");
    }
    snprintf(path, sizeof path, "%simages.txt", folder);
    put_text(project, path, text);
}

/* A model as text; the pictures' names are made of `form`. */
static void put_model(const char *project, const char *folder, const char *camera, int first, int end,
                      const char *form) {
    char text[TEXT] = "", path[256];
    append(text, "1 %s\n", camera);
    snprintf(path, sizeof path, "%scameras.txt", folder);
    put_text(project, path, text);
    snprintf(path, sizeof path, "%spoints3D.txt", folder);
    put_text(project, path, two_points);
    put_images_txt(project, folder, first, end, form);
}

static void make_colmap(const char *project, const char *camera) {
    put_pictures(project, "images", ".png", RGB);
    put_model(project, "sparse/0/", camera, 0, VIEWS, "%s.png");
}

static void add_bytes(uint8_t *data, size_t *size, const void *from, size_t n) {
    memcpy(data + *size, from, n); /* this machine's bytes are little-endian, as all that are supported */
    *size += n;
}

static void add_u64(uint8_t *data, size_t *size, uint64_t value) { add_bytes(data, size, &value, 8); }
static void add_u32(uint8_t *data, size_t *size, uint32_t value) { add_bytes(data, size, &value, 4); }

static void make_binary(const char *project, const char *rest) {
    uint8_t data[2048];
    size_t size = 0;
    const double parameters[] = {fx, fy, cx, cy};
    (void)rest;
    put_pictures(project, "images", ".png", RGB);
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
        const double pose[7] = {
            cos(turn_of(v) / 2), 0, sin(turn_of(v) / 2), 0, translations[v][0], translations[v][1],
            translations[v][2]};
        char name[8];
        add_u32(data, &size, (uint32_t)v + 1);
        add_bytes(data, &size, pose, sizeof pose);
        add_u32(data, &size, 1);
        add_bytes(data, &size, name, (size_t)snprintf(name, sizeof name, "%s.png", names[v]) + 1);
        add_u64(data, &size, 0);
    }
    put(project, "sparse/0/images.bin", data, size);
    put_text(project, "sparse/0/points3D.txt", two_points);
    /* of newer versions, and not read */
    put(project, "sparse/0/rigs.bin", "\1\2\3", 3);
    put(project, "sparse/0/frames.bin", "\4\5\6", 3);
}

static void make_flat(const char *project, const char *folder) {
    put_pictures(project, "images", ".png", RGB);
    put_model(project, folder, pinhole, 0, VIEWS, "%s.png");
}

/* As RealityScan does: all in one folder. */
static void make_beside(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, ".", ".png", RGB);
    put_model(project, "", pinhole, 0, VIEWS, "%s.png");
}

static void make_small(const char *project, const char *folder) {
    put_small(project, folder, 2);
    put_model(project, "sparse/0/", pinhole, 0, VIEWS, "%s.png");
}

static void make_several(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, "images", ".png", RGB);
    put_model(project, "sparse/0/", pinhole, 1, 2, "%s.png");
    put_model(project, "sparse/1/", pinhole, 0, VIEWS, "%s.png");
}

static void make_subfolders(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, "images/a room/left eye", ".png", RGB);
    put_model(project, "sparse/0/", pinhole, 0, VIEWS, "a room/left eye/%s.png");
}

/* Names as Windows writes them. */
static void make_backslashes(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, "images/a room", ".png", RGB);
    put_model(project, "sparse/0/", pinhole, 0, VIEWS, "a room\\%s.png");
}

static void make_marked_colmap(const char *project, const char *camera) {
    marked = 1;
    make_colmap(project, camera);
    marked = 0;
}

static void make_missing(const char *project, const char *rest) {
    make_colmap(project, rest);
    assert_int_equal(remove(test_path_in(project, "images/c.png")), 0);
}

static void make_masked(const char *project, const char *form) {
    make_colmap(project, pinhole);
    for (int v = 0; v < VIEWS; v++) {
        char name[256], path[300];
        snprintf(name, sizeof name, "%s.png", names[v]);
        snprintf(path, sizeof path, form, names[v]);
        put_mask(project, path, 1);
    }
}

/* Of 0 and 1, and of a label's number. */
static void make_label_masks(const char *project, const char *rest) {
    make_colmap(project, rest);
    put_mask_of(project, "masks/a.png", 1, 1);
    put_mask_of(project, "masks/b.png", 1, 1);
    put_mask_of(project, "masks/c.png", 1, 17);
}

/* Of which the first `hidden` keep nothing. */
static void make_black_masks(const char *project, int hidden) {
    static const char *const files[] = {"masks/a.png", "masks/b.png", "masks/c.png"};
    make_colmap(project, pinhole);
    for (int v = 0; v < VIEWS; v++) put_mask_of(project, files[v], 1, v < hidden ? 0 : 255);
}

static void make_one_black_mask(const char *project, const char *rest) {
    (void)rest;
    make_black_masks(project, 1);
}

static void make_all_masks_black(const char *project, const char *rest) {
    (void)rest;
    make_black_masks(project, VIEWS);
}

static void make_small_masks(const char *project, const char *rest) {
    make_colmap(project, rest);
    put_mask(project, "masks/a.png.png", 2);
    put_mask(project, "masks/c.png", 1);
}

static void make_kind(const char *project, kind k, const char *ending) {
    char form[16];
    snprintf(form, sizeof form, "%%s%s", ending);
    put_pictures(project, "images", ending, k);
    put_model(project, "sparse/0/", pinhole, 0, VIEWS, form);
}

static void make_grey(const char *p, const char *rest) { make_kind(p, GREY, rest); }
static void make_deep(const char *p, const char *rest) { make_kind(p, DEEP, rest); }
static void make_palette(const char *p, const char *rest) { make_kind(p, PALETTE, rest); }
static void make_interlaced(const char *p, const char *rest) { make_kind(p, INTERLACED, rest); }
static void make_alpha(const char *p, const char *rest) { make_kind(p, ALPHA, rest); }
static void make_jpeg(const char *p, const char *rest) { make_kind(p, JPEG, rest); }
static void make_progressive(const char *p, const char *rest) { make_kind(p, PROGRESSIVE, rest); }
static void make_grey_jpeg(const char *p, const char *rest) { make_kind(p, GREY_JPEG, rest); }
static void make_turned(const char *p, const char *rest) { make_kind(p, TURNED_JPEG, rest); }
static void make_cmyk(const char *p, const char *rest) { make_kind(p, CMYK_JPEG, rest); }

/* transforms.json. */

static void add_matrix(char *text, int view) {
    double R[9];
    const double *t = translations[view];
    rotation_of(view, R);
    append(text, "'transform_matrix':[");
    for (int row = 0; row < 3; row++) {
        double centre = 0;
        for (int k = 0; k < 3; k++) centre -= R[3 * k + row] * t[k];
        append(text, "[%.17g,%.17g,%.17g,%.17g],", R[row], -R[3 + row], -R[6 + row], centre);
    }
    append(text, "[0,0,0,1]]");
}

/* `head` opens the object; a frame's own keys are of the form `frame`, with its name once. */
static void put_transforms(const char *project, const char *file, int first, int end, const char *head,
                           const char *frame) {
    char text[TEXT] = "";
    append(text, "%s'frames':[", head);
    for (int v = first; v < end; v++) {
        append(text, v > first ? ",{" : "{");
        append(text, frame, names[v], names[v], names[v]);
        add_matrix(text, v);
        append(text, "}");
    }
    append(text, "]}");
    put_text(project, file, text);
}

static const char intrinsics[] = "{'w':24,'h':16,'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.5,";

static void make_ngp(const char *project, const char *more) {
    char head[512];
    snprintf(head, sizeof head, "%s'aabb_scale':16,'scale':2,'offset':[1,2,3],%s", intrinsics, more);
    put_pictures(project, "images", ".png", RGB);
    put_small(project, "images_2", 2);
    put_transforms(project, "transforms.json", 0, VIEWS, head,
                   "'file_path':'./images/%s.png','sharpness':30,");
}

static const char ply[] = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                          "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                          "end_header\n1 2 3 10 20 30\n-1 0 2 40 50 60\n";

static void make_nerfstudio(const char *project, const char *more) {
    char head[600];
    snprintf(head, sizeof head,
             "{'camera_model':'OPENCV','orientation_override':'none','ply_file_path':'sparse_pc.ply',"
             "'applied_transform':[[1,0,0,0],[0,0,1,0],[0,-1,0,0]],'applied_scale':0.5,%s",
             more);
    put_pictures(project, "images", ".png", RGB);
    put_text(project, "sparse_pc.ply", ply);
    put_transforms(project, "transforms.json", 0, VIEWS, head,
                   "'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.5,'w':24,'h':16,'k1':-0.05,'p1':0.001,"
                   "'file_path':'images/%s.png','depth_file_path':'depth/%s.png','colmap_im_id':1,");
}

static void make_marked_ngp(const char *project, const char *more) {
    marked = 1;
    make_ngp(project, more);
    marked = 0;
}

static void make_mask_path(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, "images", ".png", RGB);
    for (int v = 0; v < VIEWS; v++) {
        char name[64];
        snprintf(name, sizeof name, "m/%s-mask.png", names[v]);
        put_mask(project, name, 1);
    }
    put_transforms(project, "transforms.json", 0, VIEWS, intrinsics,
                   "'file_path':'images/%s.png','mask_path':'m/%s-mask.png',");
}

static void make_transforms_alpha(const char *project, const char *rest) {
    (void)rest;
    put_pictures(project, "images", ".png", ALPHA);
    put_transforms(project, "transforms.json", 0, VIEWS, intrinsics, "'file_path':'images/%s',");
}

/* camera_angle_x of fx = 20 at a width of 24; the principal point is the middle. */
static void make_blender(const char *project, const char *held_out) {
    static const char head[] = "{'camera_angle_x':1.0808390005411683,";
    put_png(project, "test/a.png", 0, 1, ALPHA);
    put_png(project, "train/b.png", 1, 1, ALPHA);
    put_png(project, "train/c.png", 2, 1, ALPHA);
    put_transforms(project, "transforms_train.json", 1, 3, head, "'file_path':'./train/%s','rotation':0.01,");
    put_transforms(project, held_out, 0, 1, head, "'file_path':'./test/%s','rotation':0.01,");
    if (strcmp(held_out, "transforms_val.json") != 0) put_text(project, "transforms_val.json", "not read");
}

/* OpenSfM. */

static void put_opensfm(const char *project, const char *file, const char *camera, int first, int end,
                        const char *form) {
    char text[TEXT] = "";
    append(text, "[{'cameras':{'v2 x':{'width':24,'height':16,%s}},'shots':{'odd':", camera);
    append(text, "{'rotation':[0,0,0],'translation':[0,0,0],'camera':'v2 x'}");
    append(text,
           "},'points':{}},{'cameras':{'v2 x':{'width':24,'height':16,%s}},'reference_lla':{},'shots':{",
           camera);
    for (int v = first; v < end; v++) {
        const double *t = translations[v];
        append(text, v > first ? ",'" : "'");
        append(text, form, names[v]);
        append(text,
               "':{'orientation':1,'rotation':[0,%.17g,0],'translation':[%.17g,%.17g,%.17g],'camera':'v2 x'}",
               turn_of(v), t[0], t[1], t[2]);
    }
    append(text, "},'points':{'7':{'color':[10,20,30],'coordinates':[1,2,3]},"
                 "'9':{'color':[40.0,50.0,60.0],'coordinates':[-1,0,2]}}}]");
    put_text(project, file, text);
}

/* fx and fy in the longer side, 24; the principal point from the middle. */
#define NORMALISED                                                                                           \
    "'focal_x':0.83333333333333337,'focal_y':0.875,'c_x':0.020833333333333332,'c_y':0.020833333333333332,"

static void make_opensfm(const char *project, const char *camera) {
    put_pictures(project, "images", ".png", RGB);
    put_opensfm(project, "reconstruction.json", camera, 0, VIEWS, "%s.png");
}

static void make_marked_opensfm(const char *project, const char *camera) {
    marked = 1;
    make_opensfm(project, camera);
    marked = 0;
}

static void make_odm(const char *project, const char *camera) {
    put_pictures(project, "images", ".JPG", JPEG);
    put_opensfm(project, "opensfm/reconstruction.json", camera, 0, VIEWS, "%s.JPG");
}

static void make_undistorted(const char *project, const char *camera) {
    put_pictures(project, "images", ".JPG.jpg", JPEG);
    put_opensfm(project, "reconstruction.json", camera, 0, VIEWS, "%s.JPG");
}

/* Archives: stored, by hand. */

typedef struct archive {
    uint8_t data[1 << 17], directory[1 << 14];
    size_t size, directory_size;
    unsigned count;
} archive;

static void add_u16(uint8_t *data, size_t *size, unsigned value) {
    add_bytes(data, size, &(uint16_t){(uint16_t)value}, 2);
}

/* `claimed` is the size that the entry is said to unpack to. */
static void add_entry(archive *a, const char *name, const uint8_t *data, size_t size, size_t claimed,
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

static void put_archive(archive *a, const char *name) {
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

static void pack(archive *a, const char *folder, const char *front) {
    struct dirent **entries;
    int n = scandir(folder, &entries, NULL, alphasort);
    assert_true(n >= 0);
    for (int i = 0; i < n; i++) {
        char path[1024], name[1024];
        struct stat st;
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        snprintf(name, sizeof name, "%s%s", front, entries[i]->d_name);
        if (*entries[i]->d_name != '.' && !stat(path, &st)) {
            if (S_ISDIR(st.st_mode)) {
                strcat(name, "/");
                pack(a, path, name);
            } else {
                size_t size;
                uint8_t *data = test_read(path, &size);
                add_entry(a, name, data, size, size, 0, 0100644);
                free(data);
            }
        }
        free(entries[i]);
    }
    free(entries);
}

/* project.zip, of the project in a folder `front`. */
static void zip_project(const char *project, const char *front) {
    static archive a;
    char name[256];
    memset(&a, 0, sizeof a);
    add_entry(&a, "__MACOSX/._odd", (const uint8_t *)"odd", 3, 3, 0, 0100644);
    pack(&a, test_path(project), front);
    snprintf(name, sizeof name, "%s.zip", project);
    put_archive(&a, name);
}

static void zip_colmap(const char *project, const char *front) {
    make_colmap(project, pinhole);
    zip_project(project, front);
}

static void zip_ngp(const char *project, const char *front) {
    make_ngp(project, "");
    zip_project(project, front);
}

static void zip_blender(const char *project, const char *front) {
    make_blender(project, "transforms_test.json");
    zip_project(project, front);
}

static void zip_opensfm(const char *project, const char *front) {
    make_opensfm(project, "'projection_type':'brown'," NORMALISED "'k1':0,'k2':0,'k3':0,'p1':0,'p2':0");
    zip_project(project, front);
}

/* The table. */

typedef struct fixture {
    const char *name;
    void (*make)(const char *project, const char *how);
    const char *how;
    const char *open; /* behind the project's path */
    /* options */
    const char *images, *masks;
    int sub_model; /* + 1 */
    int no_masks, hold_out_none;
    sf_alpha alpha;
    float background;
    /* what must come out */
    const char *kind, *lens, *log;
    int divisor;                              /* of the pictures' sides; 0: 1 */
    int views, tests;                         /* 0: 3 and 1; -1: none */
    int missing, masked, alphas, undistorted; /* -1: all */
    int rotated, cropped;
    int hidden; /* (PX, PY) of view a does not count */
    int color;  /* 0: the scene's; 1: black, 2: white, 3: its red as grey, 4: as a JPEG */
    int middle; /* the principal point is the middle, fy is fx */
    int no_points;
    int wide; /* a fisheye, whose pinhole picture is larger */
} fixture;

#define C .kind = "COLMAP"
#define T .kind = "transforms.json"
#define B .kind = "Blender", .no_points = 1, .middle = 1, .alphas = 3
#define O .kind = "OpenSfM", .log = "of 2 reconstructions, 1 is taken"

static const fixture fixtures[] = {
    {"simple_pinhole", make_colmap, "SIMPLE_PINHOLE 24 16 20 12.5 8.5", C, .lens = "SIMPLE_PINHOLE",
     .middle = 2},
    {"pinhole", make_colmap, pinhole, C, .lens = "PINHOLE"},
    {"simple_radial", make_colmap, "SIMPLE_RADIAL 24 16 20 12.5 8.5 -0.05", C, .lens = "SIMPLE_RADIAL",
     .middle = 2, .undistorted = 3},
    {"radial", make_colmap, "RADIAL 24 16 20 12.5 8.5 -0.05 0.01", C, .lens = "RADIAL", .middle = 2,
     .undistorted = 3},
    {"opencv", make_colmap, "OPENCV 24 16 20 21 12.5 8.5 -0.05 0.01 0.001 -0.002", C, .lens = "OPENCV",
     .undistorted = 3},
    {"opencv_fisheye", make_colmap, "OPENCV_FISHEYE 24 16 20 21 12.5 8.5 0.01 0.01 0.001 0.001", C,
     .lens = "OPENCV_FISHEYE", .wide = 1, .undistorted = 3},
    {"wide_fisheye", make_colmap, "OPENCV_FISHEYE 24 16 7.6394372684109761 8 12.5 8.5 0 0 0 0", C,
     .lens = "OPENCV_FISHEYE", .wide = 1, .undistorted = 3, .cropped = 3, .middle = 3,
     .log = "of the 180 degrees across"},
    {"full_opencv", make_colmap,
     "FULL_OPENCV 24 16 20 21 12.5 8.5 0.1 0.01 0.001 -0.002 0.001 0.2 0.02 0.001", C, .lens = "FULL_OPENCV",
     .undistorted = 3},
    {"fov", make_colmap, "FOV 24 16 20 21 12.5 8.5 1.1", C, .lens = "FOV", .wide = 1, .undistorted = 3},
    {"simple_radial_fisheye", make_colmap, "SIMPLE_RADIAL_FISHEYE 24 16 20 12.5 8.5 0.02", C,
     .lens = "SIMPLE_RADIAL_FISHEYE", .middle = 2, .wide = 1, .undistorted = 3},
    {"radial_fisheye", make_colmap, "RADIAL_FISHEYE 24 16 20 12.5 8.5 0.02 0.01", C, .lens = "RADIAL_FISHEYE",
     .middle = 2, .wide = 1, .undistorted = 3},
    {"thin_prism_fisheye", make_colmap,
     "THIN_PRISM_FISHEYE 24 16 20 21 12.5 8.5 0.02 0.01 0.001 -0.001 0.001 0.001 0.002 -0.002", C,
     .lens = "THIN_PRISM_FISHEYE", .wide = 1, .undistorted = 3},
    {"fisheye", make_colmap, "FISHEYE 24 16 20 21 12.5 8.5", C, .lens = "FISHEYE", .wide = 1,
     .undistorted = 3},
    {"simple_fisheye", make_colmap, "SIMPLE_FISHEYE 24 16 20 12.5 8.5", C, .lens = "SIMPLE_FISHEYE",
     .middle = 2, .wide = 1, .undistorted = 3},
    {"unused_camera", make_colmap, "PINHOLE 24 16 20 21 12.5 8.5\n9 EUCM 24 16 20 21 12.5 8.5 0.5 1", C,
     .lens = "PINHOLE"},
    {"binary_rigs", make_binary, "", C, .lens = "PINHOLE"},
    {"sparse_flat", make_flat, "sparse/", C},
    {"root", make_flat, "", C},
    {"beside", make_beside, "", C},
    {"backslashes", make_backslashes, "", C},
    {"marked_colmap", make_marked_colmap, pinhole, C, .lens = "PINHOLE"},
    {"images_4", make_small, "images_4", C, .divisor = 2, .log = "the pictures of images_4/ are taken"},
    {"other_size", make_small, "images", C, .divisor = 2},
    {"named_images", make_small, "photos", C, .images = "photos", .divisor = 2},
    {"sub_models", make_several, "", C, .log = "of 2 models, 1 is taken: it has most images, 3"},
    {"sub_model_0", make_several, "", C, .sub_model = 1, .views = 1, .tests = -1, .hold_out_none = 1},
    {"model_itself", make_colmap, pinhole, .open = "/sparse/0", C},
    {"sub folders", make_subfolders, "", C},
    {"missing", make_missing, pinhole, C, .views = 2, .missing = 1, .log = "c.png: skipped: "},
    {"masks_long", make_masked, "masks/%s.png.png", C, .masked = 3, .hidden = 1},
    {"masks_stem", make_masked, "masks/%s.png", C, .masked = 3, .hidden = 1,
     .log = "masks of 3 of 3 pictures"},
    {"masks_named", make_masked, "my masks/%s.png", .masks = "my masks", C, .masked = 3, .hidden = 1},
    {"masks_metashape", make_masked, "masks/%s_mask.jpg", C, .masked = 3, .hidden = 1},
    {"masks_realityscan", make_masked, "masks/%s.png.mask.png", C, .masked = 3, .hidden = 1},
    {"masks_jpeg", make_masked, "masks/%s.jpg", C, .masked = 3, .hidden = 1},
    {"masks_labels", make_label_masks, pinhole, C, .masked = 3, .hidden = 1},
    {"masks_of_others", make_masked, "masks/%s-other.png", C,
     .log = "masks: no mask fits a picture: looked for a.png.png, a.png, a_mask.png and .jpg"},
    {"masks_unused", make_masked, "other/%s.png", C},
    {"masks_refused", make_masked, "masks/%s.png", .no_masks = 1, C},
    {"masks_some", make_small_masks, pinhole, C, .masked = 2, .hidden = 1, .log = "masks of 2 of 3 pictures"},
    {"masks_one_black", make_one_black_mask, pinhole, C, .masked = 3, .hidden = 1,
     .log = "1 of 3 pictures have no pixel that counts: a mask or transparency hides all (first: "},
    {"grey", make_grey, ".png", C, .color = 3},
    {"deep", make_deep, ".png", C},
    {"palette", make_palette, ".png", C},
    {"interlaced", make_interlaced, ".png", C},
    {"png_alpha", make_alpha, ".png", C, .alphas = 3, .hidden = 1, .log = "what is transparent is ignored"},
    {"alpha_ignored", make_alpha, ".png", .alpha = SF_ALPHA_IGNORE, C, .alphas = 3},
    {"jpeg", make_jpeg, ".jpg", C, .color = 4},
    {"jpeg_progressive", make_progressive, ".jpeg", C, .color = 4},
    {"jpeg_grey", make_grey_jpeg, ".JPG", C, .color = 3},
    {"jpeg_exif", make_turned, ".jpg", C, .color = 4, .rotated = 3,
     .log = "3 pictures carry an EXIF orientation"},
    {"ngp", make_ngp, "'k1':0,'k2':0,", T, .lens = "PINHOLE", .no_points = 1},
    {"ngp_distorted", make_ngp, "'k1':-0.05,'k2':0.01,'k3':0.002,'p1':0.001,'p2':0,", T, .lens = "OPENCV",
     .undistorted = 3, .no_points = 1},
    {"ngp_fisheye", make_ngp, "'is_fisheye':true,'k1':0.01,'k4':0.001,", T, .lens = "OPENCV_FISHEYE",
     .wide = 1, .undistorted = 3, .no_points = 1},
    {"marked_ngp", make_marked_ngp, "", T, .no_points = 1},
    {"ngp_file", make_ngp, "", .open = "/transforms.json", T, .no_points = 1},
    {"ngp_images_2", make_ngp, "", .images = "images_2", T, .divisor = 2, .no_points = 1},
    {"nerfstudio", make_nerfstudio, "", T, .lens = "OPENCV", .undistorted = 3},
    {"nerfstudio_split", make_nerfstudio,
     "'train_filenames':['images/b.png'],'val_filenames':['images/a.png'],'test_filenames':['images/c.png'],",
     T, .undistorted = 3, .tests = 2},
    {"nerfstudio_masks", make_mask_path, "", T, .masked = 3, .hidden = 1, .no_points = 1},
    {"nerfstudio_no_masks", make_mask_path, "", .no_masks = 1, T, .no_points = 1},
    {"transforms_alpha", make_transforms_alpha, "", T, .alphas = 3, .hidden = 1, .no_points = 1},
    {"blender", make_blender, "transforms_test.json", B, .color = 1, .log = "blended over the background"},
    {"blender_white", make_blender, "transforms_test.json", .background = 1, B, .color = 2},
    {"blender_mask", make_blender, "transforms_test.json", .alpha = SF_ALPHA_MASK, B, .hidden = 1},
    {"blender_val", make_blender, "transforms_val.json", B, .color = 1},
    {"opensfm", make_opensfm, "'projection_type':'perspective'," NORMALISED "'k1':-0.05,'k2':0.01", O,
     .lens = "perspective", .undistorted = 3},
    {"opensfm_old", make_opensfm, "'projection_type':'perspective','focal':0.83333333333333337,'k1':0,'k2':0",
     O, .lens = "perspective", .middle = 1},
    {"opensfm_brown", make_opensfm,
     "'projection_type':'brown'," NORMALISED "'k1':-0.05,'k2':0.01,'k3':0.001,'p1':0.001,'p2':-0.001", O,
     .lens = "brown", .undistorted = 3},
    {"opensfm_simple", make_opensfm, "'projection_type':'simple_radial'," NORMALISED "'k1':-0.05", O,
     .lens = "simple_radial", .undistorted = 3},
    {"opensfm_radial", make_opensfm, "'projection_type':'radial'," NORMALISED "'k1':-0.05,'k2':0.02", O,
     .lens = "radial", .undistorted = 3},
    {"opensfm_fisheye", make_opensfm, "'projection_type':'fisheye','focal':0.83333333333333337,'k1':0,'k2':0",
     O, .lens = "fisheye", .middle = 1, .wide = 1, .undistorted = 3, .color = 4},
    {"opensfm_fisheye_opencv", make_opensfm,
     "'projection_type':'fisheye_opencv'," NORMALISED "'k1':0.01,'k2':0,'k3':0,'k4':0.001", O,
     .lens = "fisheye_opencv", .wide = 1, .undistorted = 3},
    {"marked_opensfm", make_marked_opensfm, NORMALISED "'k1':0", .open = "/reconstruction.json", O},
    {"opensfm_file", make_opensfm, NORMALISED "'k1':0", .open = "/reconstruction.json", O},
    {"opensfm_drones", make_odm, "'projection_type':'brown'," NORMALISED "'k1':0", O, .color = 4},
    {"opensfm_undistorted", make_undistorted, "'projection_type':'perspective'," NORMALISED "'k1':0", O,
     .color = 4},
#ifdef SF_HAVE_LIBZIP
    {"zip_colmap", zip_colmap, "", .open = ".zip", C},
    {"zip_folders", zip_ngp, "data/my scene/", .open = ".zip", T, .no_points = 1},
    {"zip_blender", zip_blender, "lego/", .open = ".zip", B, .color = 1},
    {"zip_opensfm", zip_opensfm, "", .open = ".zip", O},
#endif
};

enum { FIXTURES = sizeof fixtures / sizeof *fixtures };

static sf_load_options options_of(const fixture *f) {
    sf_load_options options = sf_load_options_default();
    options.images = f->images;
    options.masks = f->masks;
    options.no_masks = f->no_masks;
    options.alpha = f->alpha;
    for (int c = 0; c < 3; c++) options.background[c] = f->background;
    if (f->sub_model) options.sub_model = f->sub_model - 1;
    if (f->hold_out_none) options.hold_out = 0;
    return options;
}

static const char *where;

static void same(const char *what, double got, double expected, double tolerance) {
    if (!(fabs(got - expected) <= tolerance))
        fail_msg("%s: %s: %.12g is not %.12g", where, what, got, expected);
}

static void check_counts(const fixture *f, const sf_scene_info *info) {
    if (!info->kind || strcmp(info->kind, f->kind) != 0) fail_msg("%s: kind: %s", where, info->kind);
    int views = f->views ? f->views : VIEWS, tests = f->tests ? f->tests : 1;
    same("views", (double)info->views, views, 0);
    same("held out", (double)info->test_views, tests < 0 ? 0 : tests, 0);
    same("points", (double)info->points, f->no_points ? 0 : 2, 0);
    same("missing", (double)info->skipped_missing, f->missing, 0);
    same("poses", (double)info->skipped_pose, 0, 0);
    same("masked", (double)info->masked_views, f->masked, 0);
    same("alpha", (double)info->alpha_views, f->alphas, 0);
    same("undistorted", (double)info->undistorted_views, f->undistorted, 0);
    same("cropped", (double)info->cropped_views, f->cropped, 0);
    same("rotated", (double)info->rotated_views, f->rotated, 0);
}

static void check_camera(const fixture *f, const sf_view_info *view, int number) {
    const sf_camera *c = &view->camera;
    double R[9], divisor = f->divisor ? f->divisor : 1, x = fx, y = f->middle ? fx : fy;
    if (f->middle == 3) { /* the wide one */
        x = 24 / 3.14159265358979323846;
        y = 8;
    }
    rotation_of(number, R);
    double x0 = (f->middle == 1 ? 12 : cx) / divisor, y0 = (f->middle == 1 ? 8 : cy) / divisor;
    double left = f->wide ? round(c->cx - x0) : 0, top = f->wide ? round(c->cy - y0) : 0;
    if (f->wide && !(c->width > WIDTH && c->height >= HEIGHT && left > 0 && top >= 0))
        fail_msg("%s: size: %d x %d", where, c->width, c->height);
    if (!f->wide) same("width", c->width, WIDTH / divisor, 0);
    if (!f->wide) same("height", c->height, HEIGHT / divisor, 0);
    same("fx", c->fx, x / divisor, 1e-9);
    same("fy", c->fy, y / divisor, 1e-9);
    same("cx", c->cx, x0 + left, 1e-9);
    same("cy", c->cy, y0 + top, 1e-9);
    for (int i = 0; i < 9; i++) same("rotation", c->R_cw[i], R[i], 1e-9);
    for (int i = 0; i < 3; i++) same("translation", c->t_cw[i], translations[number][i], 1e-9);
    if (f->lens && (!view->lens || strcmp(view->lens, f->lens) != 0))
        fail_msg("%s: lens: %s", where, view->lens);
}

static void check_pixel(sf_context *ctx, const fixture *f, sf_scene *scene, const sf_view_info *view,
                        int number) {
    static float rgb[3 * 4 * WIDTH * HEIGHT], weight[4 * WIDTH * HEIGHT];
    const sf_camera *camera = &view->camera;
    int at = (int)camera->cy * camera->width + (int)camera->cx; /* the principal point's, (PX, PY) */
    assert_true(camera->width * camera->height <= 4 * WIDTH * HEIGHT);
    assert_ok(ctx, sf_scene_get_pixels(scene, view->id, rgb, weight));
    same("weight", (double)weight[at], !f->hidden, 1e-6);
    if (f->hidden) return;
    for (int c = 0; c < 3; c++) {
        double expected = f->color == 1   ? 0
                          : f->color == 2 ? 255
                                          : shade(number, PX, PY, f->color == 3 ? 0 : c);
        same("colour", 255 * (double)rgb[3 * at + c], expected, f->color >= 3 ? 2 : 0.01);
    }
}

static void check_points(sf_scene *scene) {
    float xyz[6];
    uint8_t rgb[6];
    const float expected[] = {1, 2, 3, -1, 0, 2};
    const uint8_t colors[] = {10, 20, 30, 40, 50, 60};
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, rgb), 2);
    assert_memory_equal(xyz, expected, sizeof xyz);
    assert_memory_equal(rgb, colors, sizeof rgb);
}

static void check_fixture(sf_context *ctx, const fixture *f) {
    char path[512];
    sf_scene *scene;
    sf_scene_info info;
    sf_view_info view = {0};
    sf_load_options options = options_of(f);
    where = f->name;
    f->make(f->name, f->how);
    snprintf(path, sizeof path, "%s%s", test_path(f->name), f->open ? f->open : "");
    test_log_clear();
    if (sf_scene_load(ctx, path, &options, &scene)) fail_msg("%s: %s", where, sf_last_error(ctx));
    sf_scene_get_info(scene, &info);
    check_counts(f, &info);
    if (f->log && !strstr(test_log, f->log))
        fail_msg("%s: the log lacks \"%s\": %s", where, f->log, test_log);
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        int number = f->sub_model ? 1 : (int)i;
        check_camera(f, &view, number);
        if (i == 0) check_pixel(ctx, f, scene, &view, number);
    }
    if (!f->no_points) check_points(scene);
    sf_scene_destroy(&scene);
}

static void test_fixtures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_true(FIXTURES >= 60);
    for (size_t i = 0; i < FIXTURES; i++) check_fixture(ctx, &fixtures[i]);
    sf_context_destroy(&ctx);
}

/* What is refused. */

typedef struct refusal {
    const char *name;
    void (*make)(const char *project, const char *how);
    const char *how;
    sf_status status;
    const char *part;
    const char *images, *masks;
    int sub_model; /* + 1 */
} refusal;

#define REFUSE(name_, make_, how_, status_, part_)                                                           \
    .name = name_, .make = make_, .how = how_, .status = status_, .part = part_

static const refusal refusals[] = {
    {REFUSE("no_model", make_colmap, "RAD_TAN_THIN_PRISM_FISHEYE 24 16 1 1 1 1 0 0 0 0 0 0 0 0 0 0 0 0",
            SF_ERR_UNSUPPORTED, "model RAD_TAN_THIN_PRISM_FISHEYE is not supported")},
    {REFUSE("no_such_model", make_colmap, "SIMPLE_DIVISION 24 16 1 1 1 1", SF_ERR_UNSUPPORTED,
            "model SIMPLE_DIVISION is not supported; colmap image_undistorter")},
    {REFUSE("no_panorama", make_ngp, "'camera_model':'EQUIRECTANGULAR',", SF_ERR_UNSUPPORTED,
            "camera_model: EQUIRECTANGULAR is not supported")},
    {REFUSE("no_field", make_ngp, "'camera_model':'FOV',", SF_ERR_UNSUPPORTED,
            "camera_model: FOV is not supported")},
    {REFUSE("no_ftheta", make_ngp, "'ftheta_p0':1,", SF_ERR_UNSUPPORTED,
            "camera_model: FTHETA is not supported")},
    {REFUSE("no_k5", make_ngp, "'k5':1,", SF_ERR_UNSUPPORTED, "k5: 1 is not supported")},
    {REFUSE("no_sphere", make_opensfm, "'projection_type':'spherical'", SF_ERR_UNSUPPORTED,
            "projection_type: spherical is not supported")},
    {REFUSE("no_dual", make_opensfm, "'projection_type':'dual'", SF_ERR_UNSUPPORTED,
            "projection_type: dual")},
    {REFUSE("no_focal", make_opensfm, "'k1':0", SF_ERR_FORMAT, "cameras[\"v2 x\"]: focal: is missing")},
    {REFUSE("no_number", make_opensfm, "'focal':'wide'", SF_ERR_FORMAT, "focal: is not a number")},
    {REFUSE("no_side", make_opensfm, "'width':2e9,'focal':1", SF_ERR_FORMAT,
            "width: is not a picture's side")},
    {REFUSE("turned_pictures", make_colmap, "PINHOLE 16 24 21 20 8.5 12.5", SF_ERR_EMPTY,
            "24 x 16 is not the camera's 16 x 24, nor its shape: turned, by EXIF?")},
    {REFUSE("cropped_pictures", make_colmap, "PINHOLE 24 20 21 20 12.5 8.5", SF_ERR_EMPTY,
            "24 x 16 is not the camera's 24 x 20, nor its shape: cropped?")},
    {REFUSE("no_cmyk", make_cmyk, ".jpg", SF_ERR_EMPTY, "3 lack a readable picture")},
    {REFUSE("no_images", make_colmap, pinhole, SF_ERR_IO, "absent: no such folder of pictures"),
     .images = "absent"},
    {REFUSE("no_masks", make_colmap, pinhole, SF_ERR_IO, "absent: no such folder of masks"),
     .masks = "absent"},
    {REFUSE("empty_masks", make_masked, "masks/%s-other.png", SF_ERR_IO,
            "no mask fits a picture: looked for a.png.png, a.png, a_mask.png"),
     .masks = "masks"},
    {REFUSE("black_masks", make_all_masks_black, "", SF_ERR_EMPTY,
            "training views has a pixel that counts: masks or transparency hide all")},
    {REFUSE("no_sub_model", make_several, "", SF_ERR_IO, "none of its 2 models is 7"), .sub_model = 8},
    {REFUSE("no_reconstruction", make_opensfm, "'focal':1", SF_ERR_IO, "none of its 2 reconstructions is 2"),
     .sub_model = 3},
};

static void test_refusals(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        const refusal *r = &refusals[i];
        sf_scene *scene;
        sf_load_options options = sf_load_options_default();
        r->make(r->name, r->how);
        options.images = r->images;
        options.masks = r->masks;
        if (r->sub_model) options.sub_model = r->sub_model - 1;
        assert_status(ctx, sf_scene_load(ctx, test_path(r->name), &options, &scene), r->status);
        assert_null(scene);
        assert_error_names(ctx, r->part);
        assert_error_names(ctx, r->name);
    }
    assert_true(strstr(test_log, "JPEG: colours: ") != NULL);
    sf_context_destroy(&ctx);
}

static void test_options_out_of_range(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    make_colmap("range", pinhole);
    for (int i = 0; i < 3; i++) {
        static const char *const parts[] = {"sub_model: -2", "alpha: 4", "background: 1.5"};
        sf_load_options options = sf_load_options_default();
        if (i == 0) options.sub_model = -2;
        if (i == 1) options.alpha = (sf_alpha)4;
        if (i == 2) options.background[1] = 1.5f;
        assert_status(ctx, sf_scene_load(ctx, test_path("range"), &options, &scene), SF_ERR_ARGUMENT);
        assert_error_names(ctx, parts[i]);
    }
    sf_context_destroy(&ctx);
}

/* Hostile archives. */

static void refuse_archive(sf_context *ctx, archive *a, const char *part) {
    sf_scene *scene;
    put_archive(a, "bad.zip");
    int before = test_count_entries(test_path("tmp"));
    sf_status status = sf_scene_load(ctx, test_path("bad.zip"), NULL, &scene);
    assert_int_not_equal(status, SF_OK);
    assert_error_names(ctx, test_path("bad.zip"));
#ifdef SF_HAVE_LIBZIP
    assert_error_names(ctx, part);
#else
    (void)part;
    assert_error_names(ctx, "this build reads no .zip");
#endif
    assert_int_equal(test_count_entries(test_path("tmp")), before); /* nothing is left */
}

static void test_hostile_archives(void **state) {
    (void)state;
    static const struct {
        const char *name;
        size_t claimed;
        int method;
        unsigned attributes;
        const char *part;
    } cases[] = {
        {"../out.png", 4, 0, 0100644, "../out.png: leads out"},
        {"a/../../out.png", 4, 0, 0100644, "leads out"},
        {"/etc/out.png", 4, 0, 0100644, "leads out"},
        {"..\\out.png", 4, 0, 0100644, "leads out"},
        {"a.png", 0xfffffff0u, 8, 0100644, "a.png: size: is more than its packed bytes can hold"},
        {"a.png", 4, 0, 0120777, "holds no picture and no model"}, /* a link */
        {"a.exe", 4, 0, 0100755, "holds no picture and no model"},
        {"a.png", 4, 0, 0100644, "no project"},
    };
    sf_context *ctx = test_context();
    static archive a;
    mkdir(test_path("tmp"), 0777);
    assert_int_equal(setenv("TMPDIR", test_path("tmp"), 1), 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        memset(&a, 0, sizeof a);
        add_entry(&a, cases[i].name, (const uint8_t *)"text", 4, cases[i].claimed, cases[i].method,
                  cases[i].attributes);
        refuse_archive(ctx, &a, cases[i].part);
    }
    memset(&a, 0, sizeof a);
    for (int i = 0; i < 2; i++) add_entry(&a, "a.png", (const uint8_t *)"text", 4, 4, 0, 0100644);
    refuse_archive(ctx, &a, "bad.zip");
    assert_int_equal(unsetenv("TMPDIR"), 0);
    sf_context_destroy(&ctx);
}

/* Many megabytes of nothing: possible for deflate, refused by the archive's size. */
static void test_bomb(void **state) {
    (void)state;
    enum { BLOCK = 1 << 20, BLOCKS = 64 };
    static archive a;
    static uint8_t zeros[BLOCK], packed[1 << 17];
    z_stream z = {.next_out = packed, .avail_out = sizeof packed};
    memset(&a, 0, sizeof a);
    mkdir(test_path("tmp"), 0777);
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY), Z_OK);
    for (int i = 0; i < BLOCKS; i++) {
        z.next_in = zeros;
        z.avail_in = BLOCK;
        assert_int_not_equal(deflate(&z, i == BLOCKS - 1 ? Z_FINISH : Z_NO_FLUSH), Z_STREAM_ERROR);
    }
    assert_true(z.total_out < 80000);
    add_entry(&a, "transforms.json", packed, z.total_out, (size_t)BLOCK * BLOCKS, 8, 0100644);
    deflateEnd(&z);
    sf_context *ctx = test_context();
    assert_int_equal(setenv("TMPDIR", test_path("tmp"), 1), 0);
    refuse_archive(ctx, &a, "64 MB unpacked are more than 100 times the file");
    assert_int_equal(unsetenv("TMPDIR"), 0);
    sf_context_destroy(&ctx);
}

/* What lies under a mask does not change the model by a bit. */
static void fit_masked(const char *project, float under) {
    sf_context *ctx = test_context();
    float rgb[3 * WIDTH * HEIGHT];
    make_masked(project, "masks/%s.png");
    for (int v = 0; v < VIEWS; v++) {
        char name[64];
        for (int i = 0; i < WIDTH * HEIGHT; i++)
            for (int c = 0; c < 3; c++) {
                int x = i % WIDTH, y = i / WIDTH, near = abs(x - PX) <= 2 && abs(y - PY) <= 2;
                rgb[3 * i + c] = near ? under : (float)shade(v, x, y, c) / 255;
            }
        snprintf(name, sizeof name, "images/%s.png", names[v]);
        assert_ok(ctx, sf_write_png(ctx, test_path_in(project, name), WIDTH, HEIGHT, rgb));
    }
    sf_scene *scene;
    sf_fitter *fitter;
    sf_model *model;
    sf_load_options load = sf_load_options_default();
    sf_fit_options options = sf_fit_options_default();
    load.hold_out = 0;
    options.steps = 20;
    options.init = SF_INIT_RANDOM;
    options.init_random = 200;
    assert_ok(ctx, sf_scene_load(ctx, test_path(project), &load, &scene));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    char file[128];
    snprintf(file, sizeof file, "%s.ply", project);
    assert_ok(ctx, sf_model_save(model, test_path(file)));
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_content_under_a_mask(void **state) {
    (void)state;
    size_t first_size, second_size;
    fit_masked("under-black", 0);
    fit_masked("under-white", 1);
    uint8_t *first = test_read(test_path("under-black.ply"), &first_size),
            *second = test_read(test_path("under-white.ply"), &second_size);
    assert_true(first_size > 1000);
    assert_int_equal(first_size, second_size);
    assert_memory_equal(first, second, first_size);
    free(first);
    free(second);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fixtures),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_options_out_of_range),
        cmocka_unit_test(test_hostile_archives),
        cmocka_unit_test(test_bomb),
        cmocka_unit_test(test_content_under_a_mask),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
