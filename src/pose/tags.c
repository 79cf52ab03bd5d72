/* tags.c - see tags.h. */
#include "tags.h"

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

sf_status sf_tags_find(sf_tags *t, const uint8_t *grey, size_t stride, int width, int height,
                       const sf_tag_seen **seen, size_t *count) {
    const int step = (int)t->detector->quad_decimate;
    *seen = NULL;
    *count = 0;
    /* libapriltag reads and writes outside of its memory where a reduced side is less than its tile of 4 px;
     * no tag is that small. */
    if ((width - 1) / step + 1 < LEAST_SIDE || (height - 1) / step + 1 < LEAST_SIDE) return SF_OK;
    sf_status status = sf_grow(t->ctx, &t->grey, &t->grey_capacity, 0, (size_t)width * (size_t)height, 1);
    if (status) return status;
    for (size_t y = 0; y < (size_t)height; y++)
        memcpy(t->grey + y * (size_t)width, grey + y * stride, (size_t)width);
    image_u8_t image = {.width = width, .height = height, .stride = width, .buf = t->grey};
    zarray_t *found = apriltag_detector_detect(t->detector, &image);
    if (!found) return sf_fail(t->ctx, SF_ERR_MEMORY, "tags: no memory to look for tags");
    status = take_all(t, found);
    if (!status) *count = (size_t)zarray_size(found);
    apriltag_detections_destroy(found);
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
