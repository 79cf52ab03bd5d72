/* pictures.h - where rendered pictures go: PNG files of a folder, or a stream. */
#ifndef APP_PICTURES_H
#define APP_PICTURES_H

#include "app.h"

typedef struct pictures {
    const args *a;
    sf_context *ctx;
    const char *out; /* a folder; of a stream, a file or "-" */
    int streams, depth, transmittance;
    double depth_unit; /* world units */
    sf_video_options options;
    sf_video *video;  /* once the first picture came */
    size_t count;     /* of pictures */
    size_t saturated; /* pixels whose depth is more than 16 bits hold */
    float *values;    /* [5 pixels]: colours, transmittance, depth */
    uint16_t *grey;   /* [pixels] */
    size_t room;      /* pixels that there is room for */
} pictures;

/* --out and how. */
extern const arg_option picture_options[];

/* As the options say; writes nothing yet. rate: pictures a second of a stream. 0 or an exit code;
 * pictures_end in both cases. */
int pictures_begin(const args *a, sf_context *ctx, int rate, pictures *p);

/* Renders and writes one; `name` is its file's in the folder, without .png. 0 or an exit code. */
int pictures_add(pictures *p, sf_renderer *renderer, const sf_model *model, const sf_camera *camera,
                 const sf_render_options *options, const char *name);

/* Where pictures_add writes a picture of that name, of no stream; the caller's to free. NULL: no memory. */
char *pictures_path(const pictures *p, const char *name);

/* A file beside the pictures, in the folder, of text. 0 or an exit code. */
int pictures_note(const pictures *p, const char *name, const char *text);

/* Ends a stream; after an error (not 0) a file of it is not left behind. Returns the error, or its own. */
int pictures_end(pictures *p, int error);

#endif
