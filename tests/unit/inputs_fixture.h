/* inputs_fixture.h - projects that show one scene from three cameras, each written as users have them. */
#ifndef TESTS_UNIT_INPUTS_FIXTURE_H
#define TESTS_UNIT_INPUTS_FIXTURE_H

#include "testing.h"

enum { WIDTH = 24, HEIGHT = 16, VIEWS = 3, TEXT = 16384 };

/* The scene: view k is turned by 30 k degrees about y and stands so that its t is this. The principal point
 * is the centre of pixel (PX, PY), where no lens distorts. */
enum { PX = 12, PY = 8 };
extern const double inputs_fx, inputs_fy, inputs_cx, inputs_cy;
extern const double inputs_translations[VIEWS][3];
extern const char *const inputs_names[VIEWS];

/* The rotation of a view, and the byte that its picture has at a pixel. */
void inputs_rotation_of(int view, double R[9]);
uint8_t inputs_shade(int view, int x, int y, int channel);

extern int inputs_marked; /* texts begin with a byte order mark */

/* Writes a text into the project, ready in its folder; JSON is spelled with ' for ". */
void inputs_put_text(const char *project, const char *name, const char *text);

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

/* Writes the picture of a view, its sides divided; with ALPHA: opaque in the left half, 0 from PX on. */
void inputs_put_png(const char *project, const char *name, int view, int divisor, kind k);

/* folder/a.png, b.png, c.png. */
void inputs_put_pictures(const char *project, const char *folder, const char *ending, kind k);

/* Black at (PX, PY) and around it, else `white` of 255. */
void inputs_put_mask_of(const char *project, const char *name, int divisor, int white);
void inputs_put_mask(const char *project, const char *name, int divisor);

/* A camera of COLMAP. */
extern const char inputs_pinhole[];

/* Whole projects of COLMAP. The last argument is of the table: a camera as text, a folder, or nothing. */
void inputs_make_colmap(const char *project, const char *camera);
void inputs_make_binary(const char *project, const char *rest);
void inputs_make_flat(const char *project, const char *folder);

/* As RealityScan does: all in one folder. */
void inputs_make_beside(const char *project, const char *rest);
void inputs_make_small(const char *project, const char *folder);
void inputs_make_several(const char *project, const char *rest);
void inputs_make_subfolders(const char *project, const char *rest);

/* Names as Windows writes them. */
void inputs_make_backslashes(const char *project, const char *rest);
void inputs_make_marked_colmap(const char *project, const char *camera);
void inputs_make_missing(const char *project, const char *rest);

/* A COLMAP project with a mask for each picture, named by `form`. */
void inputs_make_masked(const char *project, const char *form);

/* Of which the first `hidden` keep nothing. */
void inputs_make_black_masks(const char *project, int hidden);

/* A COLMAP project with pictures of a kind. */
void inputs_make_kind(const char *project, kind k, const char *ending);

/* `head` opens the object; a frame's own keys are of the form `frame`, with its name once. */
void inputs_put_transforms(const char *project, const char *file, int first, int end, const char *head,
                           const char *frame);

/* The first keys of a transforms.json. */
extern const char inputs_intrinsics[];

/* A project of instant-ngp; `more` are keys of the whole file. */
void inputs_make_ngp(const char *project, const char *more);

/* A reconstruction of OpenSfM of views first..end - 1; pictures are named by `form`. */
void inputs_put_opensfm(const char *project, const char *file, const char *camera, int first, int end,
                        const char *form);

/* A project of OpenSfM; `camera` is the JSON of a camera. */
void inputs_make_opensfm(const char *project, const char *camera);

/* A .zip file, written by hand entry by entry. */
typedef struct archive {
    uint8_t data[1 << 17], directory[1 << 14];
    size_t size, directory_size;
    unsigned count;
} archive;

/* `claimed` is the size that the entry is said to unpack to; `method` is the number of its compression, 0:
 * stored. */
void inputs_add_entry(archive *a, const char *name, const uint8_t *data, size_t size, size_t claimed,
                      int method, unsigned attributes);

/* Ends the archive and writes it. */
void inputs_put_archive(archive *a, const char *name);

#endif
