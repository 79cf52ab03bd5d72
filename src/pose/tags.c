/* tags.c - see tags.h. */
#include "tags.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *name;
    int tags;
} families[] = {{"tag36h11", 587}, {"tag25h9", 35}, {"tag16h5", 30}};

int sf_tags_in_family(const char *family) {
    for (size_t i = 0; i < sizeof families / sizeof *families; i++)
        if (!strcmp(families[i].name, family)) return families[i].tags;
    return 0;
}

#ifdef SF_HAVE_APRILTAG

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

/* Wrong bits of a code that are corrected. With 2, as libapriltag has it by default, chance finds tags in
 * texture, and its table takes 18 MB. */
enum { WRONG_BITS = 1 };

enum { LEAST_SIDE = 8 }; /* px, of a picture that is looked at, after it was reduced */

/* Bytes as cameras encode light. Where a pixel is half black and half white its byte is three quarters of the
 * white's: half of the byte lies inside of the black, the farther the more the picture is blurred. */
#define GAMMA 2.2
/* Around the tags there is white, in parts of the longest side of one; and how far off a corner may be from
 * where it was, px. */
#define ROOM    0.5
#define NEAR_PX 1.5

struct sf_tags {
    sf_context *ctx;
    const char *name;
    apriltag_family_t *family;
    apriltag_detector_t *detector;
    sf_tag_seen *seen;
    size_t capacity;
    uint8_t *grey; /* the picture: the detector's pictures are not const */
    size_t grey_capacity;
};

static apriltag_family_t *create_family(const char *name) {
    if (!strcmp(name, "tag36h11")) return tag36h11_create();
    if (!strcmp(name, "tag25h9")) return tag25h9_create();
    return !strcmp(name, "tag16h5") ? tag16h5_create() : NULL;
}

static void destroy_family(const char *name, apriltag_family_t *family) {
    if (!strcmp(name, "tag36h11")) tag36h11_destroy(family);
    if (!strcmp(name, "tag25h9")) tag25h9_destroy(family);
    if (!strcmp(name, "tag16h5")) tag16h5_destroy(family);
}

/* The name as it stands in the table: the caller's need not last. */
static const char *known_name(const char *family) {
    for (size_t i = 0; i < sizeof families / sizeof *families; i++)
        if (!strcmp(families[i].name, family)) return families[i].name;
    return NULL;
}

sf_status sf_tags_create(sf_context *ctx, const char *family, int decimate, sf_tags **tags) {
    *tags = NULL;
    if (!sf_tags_in_family(family))
        return sf_fail(ctx, SF_ERR_UNSUPPORTED, "tags: family: \"%s\" is not known", family);
    sf_tags *t = sf_calloc(ctx, 1, sizeof *t);
    if (!t) return SF_ERR_MEMORY;
    t->ctx = ctx;
    t->name = known_name(family);
    t->family = create_family(family);
    t->detector = t->family ? apriltag_detector_create() : NULL;
    if (!t->detector) {
        sf_tags_destroy(&t);
        return sf_fail(ctx, SF_ERR_MEMORY, "tags: no memory for a detector");
    }
    apriltag_detector_add_family_bits(t->detector, t->family, WRONG_BITS);
    t->detector->nthreads = 1;
    t->detector->quad_decimate = (float)decimate;
    t->detector->refine_edges = 1;
    *tags = t;
    return SF_OK;
}

void sf_tags_destroy(sf_tags **tags) {
    sf_tags *t = *tags;
    if (!t) return;
    if (t->detector) apriltag_detector_destroy(t->detector);
    if (t->family) destroy_family(t->name, t->family);
    sf_free(t->ctx, t->seen);
    sf_free(t->ctx, t->grey);
    sf_free(t->ctx, t);
    *tags = NULL;
}

/* libapriltag goes round the tag from its bottom left corner, against the clock. Its coordinates have the
 * middle of the first pixel at 0.5, as ours. */
static sf_tag_seen make_seen(const apriltag_detection_t *d) {
    sf_tag_seen s = {.id = d->id};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 2; k++) s.corner[i][k] = d->p[3 - i][k];
    return s;
}

static int by_id(const void *a, const void *b) {
    int x = ((const sf_tag_seen *)a)->id, y = ((const sf_tag_seen *)b)->id;
    return (x > y) - (x < y);
}

static sf_status take_all(sf_tags *t, const zarray_t *found) {
    size_t count = (size_t)zarray_size(found);
    sf_status status = sf_grow(t->ctx, &t->seen, &t->capacity, 0, count, sizeof *t->seen);
    for (size_t i = 0; !status && i < count; i++) {
        apriltag_detection_t *d;
        zarray_get(found, (int)i, &d);
        t->seen[i] = make_seen(d);
    }
    if (!status && count) qsort(t->seen, count, sizeof *t->seen, by_id);
    return status;
}

/* A part of a picture. */
typedef struct region {
    int x, y, width, height;
} region;

/* libapriltag reads and writes outside of its memory where a reduced side is less than its tile of 4 px; no
 * tag is that small. */
static int is_large(const sf_tags *t, const region *r) {
    const int step = (int)t->detector->quad_decimate;
    return (r->width - 1) / step + 1 >= LEAST_SIDE && (r->height - 1) / step + 1 >= LEAST_SIDE;
}

/* Looks for tags in a part of a picture, as `curve` has its bytes. *found is the caller's to destroy. */
static sf_status detect(sf_tags *t, const uint8_t *grey, size_t stride, const region *r,
                        const uint8_t curve[256], zarray_t **found) {
    image_u8_t image = {.width = r->width, .height = r->height, .stride = r->width, .buf = t->grey};
    for (int y = 0; y < r->height; y++) {
        const uint8_t *from = grey + (size_t)(r->y + y) * stride + r->x;
        uint8_t *to = t->grey + (size_t)y * (size_t)r->width;
        for (int x = 0; x < r->width; x++) to[x] = curve[from[x]];
    }
    *found = apriltag_detector_detect(t->detector, &image);
    return *found ? SF_OK : sf_fail(t->ctx, SF_ERR_MEMORY, "tags: no memory to look for tags");
}

/* Where the tags are, from a pixel on that a reduced picture has. */
static region region_of(const sf_tags *t, size_t count, int width, int height) {
    double low[2] = {width, height}, high[2] = {0, 0}, side = 0;
    const int step = (int)t->detector->quad_decimate;
    for (size_t i = 0; i < 4 * count; i++) {
        const double *corner = t->seen[i / 4].corner[i % 4], *next = t->seen[i / 4].corner[(i + 1) % 4];
        side = fmax(side, hypot(next[0] - corner[0], next[1] - corner[1]));
        for (int k = 0; k < 2; k++) low[k] = fmin(low[k], corner[k]), high[k] = fmax(high[k], corner[k]);
    }
    region r = {(int)fmax(0, low[0] - ROOM * side) / step * step,
                (int)fmax(0, low[1] - ROOM * side) / step * step, 0, 0};
    r.width = (int)fmin(width, ceil(high[0] + ROOM * side)) - r.x;
    r.height = (int)fmin(height, ceil(high[1] + ROOM * side)) - r.y;
    return r;
}

/* Light of bytes, 255 at the brightest of the region. */
static void make_curve(const uint8_t *grey, size_t stride, const region *r, uint8_t curve[256]) {
    int white = 1;
    for (int y = 0; y < r->height; y++)
        for (int x = 0; x < r->width; x++) {
            int byte = grey[(size_t)(r->y + y) * stride + (size_t)(r->x + x)];
            white = byte > white ? byte : white;
        }
    for (int i = 0; i < 256; i++) curve[i] = (uint8_t)(255 * pow(fmin(i / (double)white, 1), GAMMA) + 0.5);
}

/* The corners of a tag as it was seen before, where it is that. */
static void take_corners(sf_tag_seen *before, const sf_tag_seen *now) {
    double apart = 0;
    for (int i = 0; i < 8; i++)
        apart = fmax(apart, fabs(now->corner[i / 2][i % 2] - before->corner[i / 2][i % 2]));
    if (now->id == before->id && apart < NEAR_PX) *before = *now;
}

/* Tags are found in the bytes, which show them in the dark as well; their edges in light. */
static sf_status look_again(sf_tags *t, const uint8_t *grey, size_t stride, int width, int height,
                            size_t count) {
    uint8_t curve[256];
    zarray_t *found;
    region r = region_of(t, count, width, height);
    if (!is_large(t, &r)) return SF_OK;
    make_curve(grey, stride, &r, curve);
    sf_status status = detect(t, grey, stride, &r, curve, &found);
    if (status) return status;
    for (int k = 0; k < zarray_size(found); k++) {
        apriltag_detection_t *d;
        zarray_get(found, k, &d);
        sf_tag_seen now = make_seen(d);
        for (int i = 0; i < 4; i++) now.corner[i][0] += r.x, now.corner[i][1] += r.y;
        for (size_t i = 0; i < count; i++) take_corners(&t->seen[i], &now);
    }
    apriltag_detections_destroy(found);
    return SF_OK;
}

sf_status sf_tags_find(sf_tags *t, const uint8_t *grey, size_t stride, int width, int height,
                       const sf_tag_seen **seen, size_t *count) {
    uint8_t as_it_is[256];
    region whole = {0, 0, width, height};
    zarray_t *found;
    *seen = NULL;
    *count = 0;
    if (!is_large(t, &whole)) return SF_OK;
    for (int i = 0; i < 256; i++) as_it_is[i] = (uint8_t)i;
    sf_status status = sf_grow(t->ctx, &t->grey, &t->grey_capacity, 0, (size_t)width * (size_t)height, 1);
    if (!status) status = detect(t, grey, stride, &whole, as_it_is, &found);
    if (status) return status;
    size_t tags = (size_t)zarray_size(found);
    status = take_all(t, found);
    apriltag_detections_destroy(found);
    if (!status && tags) status = look_again(t, grey, stride, width, height, tags);
    if (!status) *count = tags;
    *seen = t->seen;
    return status;
}

/* What image_u8_destroy does: Debian keeps that in another library. */
static void free_image(image_u8_t *image) {
    free(image->buf);
    free(image);
}

/* The picture is that of the square with a white border around it. */
static void take_cells(const apriltag_family_t *family, const image_u8_t *image, uint8_t *cells) {
    int side = family->width_at_border, border = (family->total_width - side) / 2;
    for (int y = 0; y < side; y++)
        for (int x = 0; x < side; x++)
            cells[y * side + x] = image->buf[(y + border) * image->stride + x + border] < 128;
}

sf_status sf_tags_cells(sf_context *ctx, const char *name, int id, int *side,
                        uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS]) {
    apriltag_family_t *family = create_family(name);
    image_u8_t *image = NULL;
    if (family && id >= 0 && (uint32_t)id < family->ncodes && family->width_at_border <= SF_TAG_MOST_CELLS)
        image = apriltag_to_image(family, id);
    if (image) {
        *side = family->width_at_border;
        take_cells(family, image, cells);
        free_image(image);
    }
    if (family) destroy_family(name, family);
    return image ? SF_OK : sf_fail(ctx, SF_ERR_ARGUMENT, "tags: %s has no tag %d", name, id);
}

#else

static sf_status not_built(sf_context *ctx) {
    return sf_fail(ctx, SF_ERR_UNSUPPORTED, "tags: not built with libapriltag");
}

sf_status sf_tags_create(sf_context *ctx, const char *family, int decimate, sf_tags **tags) {
    (void)family, (void)decimate;
    *tags = NULL;
    return not_built(ctx);
}

void sf_tags_destroy(sf_tags **tags) { *tags = NULL; }

sf_status sf_tags_find(sf_tags *tags, const uint8_t *grey, size_t stride, int width, int height,
                       const sf_tag_seen **seen, size_t *count) {
    (void)tags, (void)grey, (void)stride, (void)width, (void)height, (void)seen;
    *count = 0;
    return SF_ERR_UNSUPPORTED;
}

sf_status sf_tags_cells(sf_context *ctx, const char *name, int id, int *side,
                        uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS]) {
    (void)name, (void)id, (void)side, (void)cells;
    return not_built(ctx);
}

#endif
