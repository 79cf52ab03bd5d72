/* exif.h - what a photo's file says of its camera. */
#ifndef SF_SFM_EXIF_H
#define SF_SFM_EXIF_H

#include <stdint.h>

enum { SF_EXIF_TEXT = 48 };

/* What is not said is 0 or "". */
typedef struct sf_exif {
    char make[SF_EXIF_TEXT], model[SF_EXIF_TEXT]; /* cut off, without what does not print */
    double focal_mm;                              /* of the lens */
    double focal_35;                              /* mm: of a lens with that view on film of 36 x 24 mm */
    double pixels_per_mm;                         /* of the sensor, as the picture was taken */
    int32_t width, height;                        /* px, as the picture was taken */
} sf_exif;

/* Reads the EXIF of a JPEG; nothing is said in other files, in damaged ones, and in a build without libexif.
 */
void sf_exif_read(const char *path, sf_exif *exif);

/* Whether two photos of one size were taken by one camera with one focal length, for all that is said. */
int sf_exif_is_same(const sf_exif *a, const sf_exif *b);

/* The focal length in px of a photo that is width x height px now: reduced since it was taken, or cut along
 * one side. 0: none is told, or the photo was changed in another way. */
double sf_exif_focal(const sf_exif *exif, int32_t width, int32_t height);

#endif
