/* bounds.h - what a kernel must give, in float64, and beside each value how far float32 may be from it.
 *
 * Where a value lies within its bound of a threshold, either side of it is right: a cliff. Those are found
 * here and left to the caller to leave out.
 */
#ifndef TESTS_REFERENCE_BOUNDS_H
#define TESTS_REFERENCE_BOUNDS_H

#include "kernels/kernels.h"

#include "bounded.h"

/* A tile, front to back: every entry meets every pixel. */
typedef struct test_ref_tile {
    bounded rgb[3][SF_TILE_PIXELS], transmittance[SF_TILE_PIXELS], depth[SF_TILE_PIXELS];
    uint8_t cliff[SF_TILE_PIXELS];          /* a pair at 1/255, or the stop at 1e-4 */
    uint8_t gradient_cliff[SF_TILE_PIXELS]; /* that, or a pair at the clamp */
    uint64_t pairs, saturated, stopped;     /* blended; of these, clamped; pixels */
} test_ref_tile;

/* Reads splats, entries, count, x0, y0 and background. */
void test_ref_blend_tile(const sf_blend_args *a, test_ref_tile *tile);
/* Reads d_rgb, too, which must be 0 on the gradient's cliffs. sums: [count][9]. */
void test_ref_blend_tile_backward(const sf_blend_args *a, const test_ref_tile *tile, bounded (*sums)[9]);
/* Reads weight, too; that and d_rgb must be 0 on the cliffs of the picture, d_rgb alone may be on the
 * gradient's. sums: [count][9], of which SF_IMPORTANCE_SUMS are in use. */
void test_ref_blend_tile_worth(const sf_blend_args *a, const test_ref_tile *tile, bounded (*sums)[9]);

/* Tiles first .. end-1 of a row; empty where end <= first. */
typedef struct test_ref_span {
    int first, end;
} test_ref_span;

/* Row `row` of tiles: `needed` are those from the first to the last that hold a visible centre of a pixel,
 * `allowed` those that the ellipse reaches with a hundredth of a pixel more around it. */
void test_ref_span_row(const sf_splat *splat, int row, int tiles_x, test_ref_span *needed,
                       test_ref_span *allowed);

/* One channel of the loss: rows of sums, [height], and the gradient, [height * width]. */
typedef struct test_ref_channel {
    bounded *l1, *ssim, *d_x;
    uint8_t *cliff; /* [height * width]: the sign of L1 is open */
} test_ref_channel;

/* Reads x, y, weight, width, height, stride, delta and the two scales. free() the four. */
void test_ref_loss_channel(const sf_loss_args *a, test_ref_channel *channel);

/* A Gaussian on the screen. */
typedef struct test_ref_seen {
    int state;         /* SF_SEEN ... */
    int open;          /* it may be another: within the bound of a limit, or unseen for two reasons */
    bounded splat[16]; /* in the order of sf_splat's floats */
    /* Rows of tiles: those with a centre of pixels in the tight box, and those that a hundredth of a pixel
     * more reaches between centres, too; empty where end <= first. */
    int needed_first, needed_end, allowed_first, allowed_end;
} test_ref_seen;

/* Reads eye, params, sh_degree and antialiased. */
void test_ref_see(const sf_project_args *a, size_t i, test_ref_seen *seen);

/* The gradient of one Gaussian that is seen, from its nine sums. */
typedef struct test_ref_raw_gradient {
    bounded field[SF_FIELD_COUNT][21]; /* 0 above sh_degree */
    bounded screen, camera[SF_CAMERA_SUMS];
    int open;       /* within the bound of a clamp */
    int not_finite; /* to be left out */
} test_ref_raw_gradient;

void test_ref_unsee(const sf_project_args *a, size_t i, const double sums[9],
                    test_ref_raw_gradient *gradient);

#endif
