/* spz.h - .spz files: the header, the columns, and how each field becomes bytes. README.md has the layout. */
#ifndef SF_IO_SPZ_H
#define SF_IO_SPZ_H

#include <string.h>

#include "gaussian.h"

enum {
    SF_SPZ_HEADER = 16,
    SF_SPZ_GZIPPED = 3,        /* the version that is written, and the last one in a stream of gzip */
    SF_SPZ_STREAMS = 4,        /* the version of one stream of zstd a column */
    SF_SPZ_FRACTION_MOST = 23, /* of the fractional bits that are written */
    SF_SPZ_MEAN_MOST = (1 << 23) - 1
};

/* Columns, in the order of the file: a field of all Gaussians each. */
typedef enum sf_spz_column {
    SF_SPZ_MEANS,
    SF_SPZ_ALPHAS,
    SF_SPZ_COLORS,
    SF_SPZ_SCALES,
    SF_SPZ_ROTATIONS,
    SF_SPZ_SH,
    SF_SPZ_COLUMNS
} sf_spz_column;

typedef struct sf_spz_header {
    uint32_t version, count;
    int sh_degree; /* of the file, 0..4 */
    int fraction;  /* fractional bits of a mean's 24 */
    int antialiased, extended;
} sf_spz_header;

/* Bytes of a Gaussian in a column. */
int sf_spz_width(const sf_spz_header *h, sf_spz_column column);

/* Whether a file begins so: with gzip's first bytes, or with "NGSP". */
static inline int sf_spz_begins(const uint8_t *data, size_t size) {
    return (size >= 2 && data[0] == 0x1f && data[1] == 0x8b) || (size >= 4 && !memcmp(data, "NGSP", 4));
}

/* What the columns of the written version cannot hold, values counted. */
typedef struct sf_spz_clips {
    size_t means, scales, colors, sh;
} sf_spz_clips;

/* One Gaussian's bytes of a column of the written version. `sh_bits` 1..8, of band 1 and of those above. */
void sf_spz_encode(const sf_spz_header *h, sf_spz_column column, const int sh_bits[2], const sf_gaussians *g,
                   uint8_t *to, sf_spz_clips *clips);

/* The same back, of any version; coefficients up to `sh_degree` <= 3. */
void sf_spz_decode(const sf_spz_header *h, sf_spz_column column, int sh_degree, const uint8_t *from,
                   const sf_gaussians *g);

/* How a model is written: what of it the file can do without. */
typedef struct sf_spz_plan {
    int fraction;     /* fractional bits of the means */
    int sh_bits[2];   /* 0: by the class of each Gaussian */
    uint8_t *classes; /* [count], NULL where sh_bits are given */
    uint32_t *order;  /* [count] */
} sf_spz_plan;

/* A plan for a model and the sh_bits of sf_model_file_options. What a plan holds is freed by
 * sf_spz_free_plan, also after a failure. */
sf_status sf_spz_make_plan(const sf_model *model, const int sh_bits[2], const char *path, sf_spz_plan *plan);
void sf_spz_free_plan(sf_context *ctx, sf_spz_plan *plan);

/* Bits of SH of the model's i-th Gaussian: of band 1, of those above. */
void sf_spz_sh_bits(const sf_spz_plan *plan, size_t i, int bits[2]);

#endif
