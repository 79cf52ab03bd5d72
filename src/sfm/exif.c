/* exif.c - see exif.h. The tags are those of CIPA's DC-008 (Exif 2.32), 4.6. */
#include "exif.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#ifdef SF_HAVE_LIBEXIF

#include <libexif/exif-data.h>
#include <libexif/exif-loader.h>
#include <libexif/exif-utils.h>

static void read_text(ExifData *data, ExifTag tag, char text[SF_EXIF_TEXT]) {
    const ExifEntry *e = exif_data_get_entry(data, tag);
    size_t length = 0;
    if (!e || e->format != EXIF_FORMAT_ASCII || !e->data) return;
    for (unsigned i = 0; i < e->size && e->data[i] && length + 1 < SF_EXIF_TEXT; i++) {
        int prints = e->data[i] >= ' ' && e->data[i] < 0x7f;
        if (prints && (length || e->data[i] != ' ')) text[length++] = (char)e->data[i];
    }
    while (length && text[length - 1] == ' ') length--;
    text[length] = 0;
}

/* A number of any kind; 0: there is none above 0. */
static double read_number(ExifData *data, ExifTag tag) {
    const ExifEntry *e = exif_data_get_entry(data, tag);
    if (!e || !e->data || !e->components || e->size < exif_format_get_size(e->format)) return 0;
    ExifByteOrder order = exif_data_get_byte_order(data);
    if (e->format == EXIF_FORMAT_SHORT) return exif_get_short(e->data, order);
    if (e->format == EXIF_FORMAT_LONG) return exif_get_long(e->data, order);
    if (e->format != EXIF_FORMAT_RATIONAL) return 0;
    ExifRational r = exif_get_rational(e->data, order);
    return r.denominator ? (double)r.numerator / r.denominator : 0;
}

static int32_t read_side(ExifData *data, ExifTag tag) {
    double side = read_number(data, tag);
    return side >= 1 && side <= 1 << 20 ? (int32_t)side : 0;
}

static double read_pixels_per_mm(ExifData *data) {
    int unit = (int)fmin(read_number(data, EXIF_TAG_FOCAL_PLANE_RESOLUTION_UNIT), 9);
    double mm = unit == 3 ? 10 : unit == 4 ? 1 : unit == 5 ? 1e-3 : 25.4;
    return read_number(data, EXIF_TAG_FOCAL_PLANE_X_RESOLUTION) / mm;
}

void sf_exif_read(const char *path, sf_exif *exif) {
    *exif = (sf_exif){.make = ""};
    ExifLoader *loader = exif_loader_new();
    if (!loader) return;
    exif_loader_write_file(loader, path);
    ExifData *data = exif_loader_get_data(loader);
    exif_loader_unref(loader);
    if (!data) return;
    read_text(data, EXIF_TAG_MAKE, exif->make);
    read_text(data, EXIF_TAG_MODEL, exif->model);
    exif->focal_mm = read_number(data, EXIF_TAG_FOCAL_LENGTH);
    exif->focal_35 = read_number(data, EXIF_TAG_FOCAL_LENGTH_IN_35MM_FILM);
    exif->pixels_per_mm = read_pixels_per_mm(data);
    exif->width = read_side(data, EXIF_TAG_PIXEL_X_DIMENSION);
    exif->height = read_side(data, EXIF_TAG_PIXEL_Y_DIMENSION);
    exif_data_unref(data);
}

#else

void sf_exif_read(const char *path, sf_exif *exif) {
    (void)path;
    *exif = (sf_exif){.make = ""};
}

#endif

/* Zooms say their focal length to a tenth of a mm, or to a part in a hundred. */
static int is_same_length(double a, double b) { return fabs(a - b) <= 0.01 * fmax(a, b); }

static int is_same_size(const sf_exif *a, const sf_exif *b) {
    return (a->width == b->width && a->height == b->height) ||
           (a->width == b->height && a->height == b->width);
}

int sf_exif_is_same(const sf_exif *a, const sf_exif *b) {
    return !strcmp(a->make, b->make) && !strcmp(a->model, b->model) && is_same_size(a, b) &&
           is_same_length(a->focal_mm, b->focal_mm) && is_same_length(a->focal_35, b->focal_35);
}

/* The focal length in px of a picture of that size on the whole sensor. What it is on film is told for equal
 * diagonals (CIPA DCG-001); pictures wider than 3:2 are cut from sensors of 3:2 or 4:3, for which the longer
 * side over 36 and 34.6 mm gives the same, and squares from the middle of such a sensor. */
static double focal_of(const sf_exif *e, double longer, double shorter) {
    const double film = hypot(36, 24);
    double by_sensor = e->focal_mm * e->pixels_per_mm, by_film = 0;
    if (longer > 1.55 * shorter)
        by_film = e->focal_35 / 35.3 * longer;
    else if (longer > 1.2 * shorter)
        by_film = e->focal_35 / film * hypot(longer, shorter);
    else
        by_film = e->focal_35 / film * 5 / 3 * shorter;
    /* What the sensor's pixels give is not rounded to mm, but where the picture was reduced in the camera it
     * may be that of the whole sensor: then only film tells. */
    if (!(by_film > 0)) return by_sensor;
    return by_sensor > 0 && fabs(log(by_sensor / by_film)) < 0.1 ? by_sensor : by_film;
}

static int is_near(double a, double b) { return fabs(a - b) <= fmax(2, 0.01 * b); }

double sf_exif_focal(const sf_exif *e, int32_t width, int32_t height) {
    double longer = width > height ? width : height, shorter = width + (double)height - longer;
    double was_longer = e->width > e->height ? e->width : e->height,
           was_shorter = e->width + (double)e->height - was_longer;
    if (!(was_shorter > 0)) was_longer = longer, was_shorter = shorter;
    double scale = longer / was_longer;
    if (!is_near(was_shorter * scale, shorter)) {
        /* A square of a picture's shorter side, or a strip of its longer one. */
        if (!is_near(was_longer, longer) && !is_near(was_shorter, shorter)) return 0;
        scale = 1;
    }
    double focal = focal_of(e, was_longer, was_shorter) * scale;
    /* Angles of view from 1.4 to 136 degrees: nothing else is a lens whose focal length is told. */
    return focal > 0.2 * longer && focal < 40 * longer ? focal : 0;
}
