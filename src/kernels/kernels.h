/* kernels.h - the table of hot loops, and the contract that each entry keeps.
 *
 * arch/scalar holds the specification of every kernel in plain C. A table starts as all-scalar; each level of
 * the machine then overwrites the entries that it does better. Stages hold a `const sf_kernels *` and name no
 * level.
 *
 * For all kernels: arrays do not overlap. Float arrays of Gaussians, planes of pixels and scratch are 64-byte
 * aligned, the others as their type. Arrays of Gaussians are padded to a
 * multiple of SF_LANES with neutral entries (invisible: logit-opacity -20), so that there are no tails.
 * Kernels cannot fail, allocate, lock or print. Denormals are flushed. Equation numbers M are those of
 * src/render/README.md, S those of src/sfm/README.md.
 */
#ifndef SF_KERNELS_KERNELS_H
#define SF_KERNELS_KERNELS_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <splatfit/status.h>

/* tests/stability/fast_math.sh, which shows what would happen, defines SF_FAST_MATH_ANYWAY. */
#if !defined(SF_FAST_MATH_ANYWAY) &&                                                                         \
    (defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__))
#error "-ffast-math and -ffinite-math-only change results: each operation must be rounded by itself, NaN seen"
#endif

enum {
    SF_LANES = 16, /* Gaussians a block */
    SF_TILE = 16,  /* px a side */
    SF_TILE_PIXELS = SF_TILE * SF_TILE,
    SF_SUMS = 9,            /* floats a slot of gradient sums */
    SF_IMPORTANCE_SUMS = 8, /* those that blend_importance uses */
    SF_SSIM_RADIUS = 5
};

/* Constants of the blending are floats, those of the projection doubles: see arch/scalar/project.c. */
#define SF_ALPHA_MIN (1.0f / 255.0f) /* a pair below it is skipped */
#define SF_ALPHA_MAX 0.99f           /* alpha' is clamped here; no gradient passes the clamp */
#define SF_T_STOP    1e-4f           /* a pixel is finished before the Gaussian that would bring T under it */
#define SF_LOW_PASS  0.3             /* px^2: the usual sf_eye.low_pass */
#define SF_QUAT_MIN  1e-12           /* quaternions of a smaller norm are culled */
#define SF_LOG2_255  7.99435343685886

/* sqrt(log2(e) / 2), folded into the whitening factors so that the exponent is one of base 2; 2 ln 2 undoes
 * its square. */
#define SF_WHITEN      0.84932180028801904272
#define SF_WHITEN_UNDO 1.38629436111989061883

#define SF_SSIM_C1 1e-4f
#define SF_SSIM_C2 9e-4f

/* The learned fields: name, components of a Gaussian. This one list drives storage, optimiser, growth and
 * export. SH is stored by band; a band above the model's degree has no array. Component order within a band:
 * coefficient-major, RGB innermost. */
#define SF_FIELDS(X)                                                                                         \
    X(mean, 3)                                                                                               \
    X(log_scale, 3)                                                                                          \
    X(quat, 4)                                                                                               \
    X(logit_opacity, 1)                                                                                      \
    X(sh0, 3)                                                                                                \
    X(sh1, 9)                                                                                                \
    X(sh2, 15)                                                                                               \
    X(sh3, 21)

#define SF_FIELD_ENUM(name, components) SF_FIELD_##name,
enum { SF_FIELDS(SF_FIELD_ENUM) SF_FIELD_COUNT };
#undef SF_FIELD_ENUM

/* Arrays of the fields, blocked by SF_LANES: component c of Gaussian i of a field with C components stands at
 * ((i / SF_LANES) C + c) SF_LANES + i % SF_LANES. NULL for a band that is not stored. */
typedef struct sf_params {
    float *field[SF_FIELD_COUNT];
} sf_params;

static inline size_t sf_at(size_t i, int components, int c) {
    return (i / SF_LANES * (size_t)components + (size_t)c) * SF_LANES + i % SF_LANES;
}

/* The camera constants of a view, as the kernels take them: everything that is the same for all Gaussians. */
typedef struct sf_eye {
    float R[9], t[3];       /* world to camera */
    float center[3];        /* in the world */
    float fx, fy, cx, cy;   /* px */
    float clamp_x, clamp_y; /* 1.3 W / (2 fx), 1.3 H / (2 fy) */
    float near_plane;       /* world units */
    double low_pass;        /* px^2 on the diagonal of the 2D covariance, above 0 */
    int width, height;      /* px */
    int tiles_x, tiles_y;
} sf_eye;

/* A projected Gaussian. Offsets d are pixel centre minus mean. In whitened form t = l00 dx + l01 dy, s = m
 * dy: o g = exp2(log2_opacity - t^2 - s^2) (M.1). slope, reach, squeeze and lean are the row-interval
 * coefficients: the row at dy is covered from u + slope dy - sqrt(reach - squeeze dy^2) to u + slope dy +
 * sqrt(reach - squeeze dy^2). Its right end is farthest right at dy = lean, its left end farthest left at
 * -lean.
 */
typedef struct sf_splat {
    float u, v;         /* mean, px */
    float l00, l01, m;  /* 1/px */
    float log2_opacity; /* of the opacity in effect */
    float rgb[3];
    float depth; /* camera z */
    float slope, reach, squeeze, lean;
    float half_width, half_height; /* of the tight box, px */
} sf_splat;

/* Why a Gaussian has no pixels. */
enum { SF_SEEN = 0, SF_OUT_OF_VIEW = 1, SF_NOT_FINITE = 2 };

/* Tiles x0 .. x1-1 of one row of tiles; empty where x1 <= x0. */
typedef struct sf_span {
    uint16_t x0, x1;
} sf_span;

typedef struct sf_project_args {
    const sf_eye *eye;
    sf_params params;
    int sh_degree;    /* bands to use; no higher than what is stored */
    int antialiased;  /* opacity compensation, M.3 */
    sf_splat *splats; /* out: [n]; undefined where state is not SF_SEEN */
    uint8_t *state;   /* out: [n], SF_SEEN ...; SF_NOT_FINITE also for a quaternion below SF_QUAT_MIN */
    uint16_t *first_row, *rows; /* out: [n], rows of tiles touched; 0 rows where not seen */
} sf_project_args;

/* The camera's gradient (M.6): dL/d(rho, phi), then dL/dlog fx, dL/dlog fy. */
enum { SF_CAMERA_SUMS = 8 };

typedef struct sf_project_bwd_args {
    sf_project_args forward; /* as given to project, with its results */
    const uint32_t *slot;    /* [n + 1]: the slots of Gaussian i are slot[i] .. slot[i+1]-1 */
    const float *sums;       /* [slots][SF_SUMS], from blend_bwd */
    sf_params grads;         /* out: the blocks' own, starting with block `first`; overwritten for all lanes,
                                0 for what is not seen and for bands above sh_degree */
    float *screen;           /* out: [n] norm of dL/d(u, v) in device units (x W/2, y H/2); 0 if not seen */
    double *camera;          /* [SF_CAMERA_SUMS], added to; NULL: not wanted */
    unsigned *not_finite;    /* added to: Gaussians left out for a gradient that was not finite */
} sf_project_bwd_args;

/* One tile. Planes point at its first pixel, rows are `stride` floats apart, and reach SF_TILE px in both
 * directions even where the picture ends: what a kernel writes outside of the picture is of no meaning but
 * finite, and d_rgb is 0 there. */
typedef struct sf_blend_args {
    const sf_splat *splats;
    const uint32_t *entries; /* [count] indices into splats, near to far */
    uint32_t count;
    int x0, y0; /* of the first pixel, px */
    size_t stride;
    float background[3];
    float *rgb[3];         /* blend: out, with the background; blend_bwd: in */
    float *transmittance;  /* blend: out */
    float *depth;          /* blend: out, sum of w z; NULL: not wanted */
    uint32_t *last;        /* [SF_TILE_PIXELS] where pixels stopped, in the level's own form: blend and
                              blend_bwd of one level belong together; blend: out; blend_bwd: in */
    uint64_t *parts;       /* [count] the parts of the tile that each entry reaches, in the level's own form
                              too; those after the last that a pixel took stay untouched */
    const float *d_rgb[3]; /* blend_bwd; blend_importance: m (C - y), with the weight m of each pixel */
    const float *weight;   /* blend_importance: m; 0 beyond the picture */
    const uint32_t *slots; /* blend_bwd, blend_importance: [count] slot of each entry */
    float *sums; /* out, [slots][SF_SUMS], 0s for an entry of no effect. blend_bwd: sum over pixels of
                    w d_rgb (3), p, p t, p s, p t^2, p t s, p s^2 (M.2 with the whitened offsets).
                    blend_importance: of w d_rgb (3), D . d_rgb, m |D|^2, m w^2, w |d_rgb|^2, m w, where D
                    = w c - alpha / (1 - alpha) (what lies behind) is what the picture would lose */
} sf_blend_args;

/* Rows first_row .. end_row-1 of one channel of the loss, and its gradient (M.5). Rows are `stride` floats
 * apart; x, y and weight may hold anything beyond the picture. */
typedef struct sf_loss_args {
    const float *x;      /* rendered */
    const float *y;      /* target, times the weight already */
    const float *weight; /* of each pixel; NULL: 1 */
    int width, height;   /* px */
    size_t stride;
    int first_row, end_row;
    float *scratch;   /* sf_loss_scratch(stride) floats */
    float delta;      /* 0: L1; else Huber's: d^2 / (2 delta) for |d| <= delta, |d| - delta / 2 beyond */
    double *l1;       /* out: [end_row - first_row] sums over each row of that, of d = weight x - y */
    double *ssim;     /* out: like l1, of S; NULL: L1 alone */
    float l1_scale;   /* (1 - lambda) / (3 sum m) */
    float ssim_scale; /* -lambda / (3 sum m); 0, as it must be without ssim: the gradient of L1 alone */
    float *d_x;       /* out: the rows' gradient, 0 beyond the width; NULL: not wanted */
} sf_loss_args;

/* Huber's loss with this delta is L1: both come of one formula, |d| - h + h^2 / (2 delta) with h = min(|d|,
 * delta), and slope d / delta within -1..1. */
#define SF_LOSS_LEAST_DELTA 1e-20f

/* Room for rows on their way through the two filters: rings of rows of four planes and three maps, and as
 * many again as one ring, each with margins. */
enum { SF_LOSS_RING = 16, SF_LOSS_SCRATCH_ROWS = 8 * SF_LOSS_RING };

static inline size_t sf_loss_scratch(size_t stride) {
    return SF_LOSS_SCRATCH_ROWS * (stride + 2 * (size_t)SF_LANES);
}

typedef struct sf_adam {
    float rate;         /* with the correction of the first moment's start in it: rate / (1 - beta1^t) */
    float beta1, beta2; /* decays */
    float v_scale;      /* 1 / (1 - beta2^t) */
    float epsilon;
} sf_adam;

/* Both moments of a parameter in one word of 32 bits, each with float32's own exponent: the upper half is the
 * upper half of m (sign, 8 bits of exponent, 7 of fraction), the lower half is bits 15 to 30 of v (8 and 8).
 * A word of 0 is 0 and 0. */
#define SF_MOMENT_MOST 0x1p50f /* greater gradients count as this: no square overflows */

static inline float sf_float_of(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline uint32_t sf_bits_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* What rounding number i goes by: uniform where i is, which the caller draws anew for each step. Neighbours
 * need not be independent: they go by the golden ratio, so that their errors even out. */
#define SF_NOISE_STRIDE 0x9e3779b9u
static inline uint32_t sf_noise(uint32_t i) { return i * SF_NOISE_STRIDE; }

/* How bytes Y, U, V become R, G, B (src/capture/README.md): with y = (Y - y_zero) y_scale, u = U - 128, v = V
 * - 128, R = y + r_v v, G = y - (g_u u + g_v v), B = y + b_u u, each clamped to 0..1. All are >= 0. */
typedef struct sf_yuv {
    float y_zero, y_scale;
    float r_v, g_u, g_v, b_u;
} sf_yuv;

/* One row of a frame. Where the width is odd, the last chroma is of one pixel: a row of SF_PIXEL_YUYV or UYVY
 * has 4 ((width + 1) / 2) bytes, a row of halved chroma (width + 1) / 2 samples. */
typedef struct sf_convert_args {
    int format;              /* an sf_pixel_format, any but SF_PIXEL_MJPEG */
    const uint8_t *plane[3]; /* what the row has of each plane of the format */
    int width;               /* px */
    const sf_yuv *yuv;       /* NULL for SF_PIXEL_RGB24 and BGR24 */
    float *rgb[3];           /* out: [width] each, aligned as floats */
} sf_convert_args;

/* Rows of a picture made blurrier (S.1). They have SF_LANES floats beyond `width`, which may hold anything
 * finite, and are written up to a multiple of SF_LANES. */
enum { SF_BLUR_RADIUS = 16, SF_BLUR_ROWS = 4 };

typedef struct sf_blur_args {
    const float *const
        *rows;         /* [2 radius + count] from `radius` rows above the first to as many below the last */
    const float *taps; /* [radius + 1] weights, that of the middle first */
    int radius;        /* px, 1..SF_BLUR_RADIUS */
    int width;         /* px */
    int count;         /* rows to be made, 1..SF_BLUR_ROWS */
    float *scratch;    /* sf_blur_scratch(width) floats */
    float *out[SF_BLUR_ROWS];        /* out: [width] each */
    float *difference[SF_BLUR_ROWS]; /* out: [width] each, out less the row as it was; NULL: not wanted */
} sf_blur_args;

/* Floats of a row on its way, with margins. */
static inline size_t sf_blur_stride(int width) {
    return ((size_t)width + SF_LANES - 1) / SF_LANES * SF_LANES + 2 * SF_LANES;
}

static inline size_t sf_blur_scratch(int width) { return SF_BLUR_ROWS * sf_blur_stride(width); }

/* Columns first .. end-1 of a row of differences between two levels. Rows reach SF_LANES floats beyond
 * column `end`. */
typedef struct sf_extrema_args {
    const float *rows[3][3]; /* of the differences one finer, of this one, one coarser: above, at, below */
    int first, end;          /* first at least 1 */
    float threshold;         /* above 0 */
    uint32_t *columns;       /* out: [end - first] */
} sf_extrema_args;

/* `count` (1..SF_LANES) points of one level, and a square of SF_PATCH x SF_PATCH samples about each: sample
 * (i, j) is at (x + u a - v b, y + u b + v a) for u = i - 7.5, v = j - 7.5 and the step (a, b); a place
 * beyond the rows has the nearest one's value. */
enum { SF_PATCH = 16, SF_ORIENTATIONS = 32, SF_DESCRIPTOR = 128 };

typedef struct sf_patch_args {
    const float *pixels; /* [height][stride], aligned; all finite */
    size_t stride;       /* floats; at most 2^16 */
    int width, height;   /* px, 2 at least; height stride below 2^24 */
    size_t count;
    float x[SF_LANES], y[SF_LANES]; /* px, (0, 0) is the first pixel's middle; within the rows */
    float a[SF_LANES], b[SF_LANES]; /* of lanes from `count` on nothing is read but finite numbers */
    float *out; /* out: orient [SF_ORIENTATIONS][SF_LANES], describe [SF_DESCRIPTOR][SF_LANES]; those of
                   lanes from `count` on are of no meaning */
} sf_patch_args;

/* Descriptors against descriptors. Bytes are at most SF_MATCH_MOST. Column c of b has byte k at ((c /
 * SF_LANES) (SF_DESCRIPTOR / 4) + k / 4) 4 SF_LANES + c % SF_LANES 4 + k % 4. */
enum { SF_MATCH_MOST = 127, SF_MATCH_ROWS = 8, SF_MATCH_BLOCK = 2048 };

typedef struct sf_match_args {
    const uint8_t *a;                /* [rows][SF_DESCRIPTOR], aligned as Gaussians are */
    const uint8_t *b;                /* [columns] as above, aligned */
    size_t rows, columns;            /* multiples of SF_MATCH_ROWS and 2 SF_LANES, SF_MATCH_BLOCK at most */
    uint32_t *row_best, *row_second; /* out: [rows] greatest and second keys over the columns */
    uint32_t *column_best, *column_second; /* out: [columns] the same over the rows; aligned */
} sf_match_args;

/* What the points that one observation's row shares with other views take out of it. */
typedef struct sf_schur_args {
    const double *Y;      /* [3][6]: pose by point of the row's view, */
    const double *Z;      /* [count][3][6]: and of the other observations of the point */
    const uint32_t *rank; /* [count]: the views of these, */
    size_t count;         /* of which those up to `last` count */
    uint32_t last;
    const uint32_t *table; /* [last + 1]: each view's block of the row */
    double *blocks;        /* in and out: [6][6] each; no two of the views have one block */
} sf_schur_args;

/* The key of a product with descriptor `index` of the block: of equal products, the first has the greater. */
static inline uint32_t sf_match_key(uint32_t product, uint32_t index) {
    return product * SF_MATCH_BLOCK + (SF_MATCH_BLOCK - 1 - index);
}
static inline uint32_t sf_match_product(uint32_t key) { return key / SF_MATCH_BLOCK; }
static inline uint32_t sf_match_index(uint32_t key) { return SF_MATCH_BLOCK - 1 - key % SF_MATCH_BLOCK; }

/* The kernels: of frames, then in the order of a step, then of photos whose cameras are looked for. */
#define SF_KERNELS(X)                                                                                        \
    X(convert)                                                                                               \
    X(project)                                                                                               \
    X(spans)                                                                                                 \
    X(blend)                                                                                                 \
    X(unpack)                                                                                                \
    X(loss)                                                                                                  \
    X(blend_bwd)                                                                                             \
    X(blend_importance)                                                                                      \
    X(project_bwd)                                                                                           \
    X(adam)                                                                                                  \
    X(adam_half)                                                                                             \
    X(rmsprop)                                                                                               \
    X(blur)                                                                                                  \
    X(extrema)                                                                                               \
    X(orient)                                                                                                \
    X(describe)                                                                                              \
    X(match)                                                                                                 \
    X(schur)

#define SF_KERNEL_ENUM(name) SF_KERNEL_##name,
enum { SF_KERNELS(SF_KERNEL_ENUM) SF_KERNEL_COUNT };
#undef SF_KERNEL_ENUM

typedef struct sf_kernels {
    const char *isa;                    /* highest level in the table */
    const char *level[SF_KERNEL_COUNT]; /* of each kernel */

    /* One row of a camera's picture as sRGB values 0..1: bytes times 1/255, or through the matrix above, as
     * it is written there, each operation rounded to float32 for itself: all levels give the same bytes. */
    void (*convert)(const sf_convert_args *args);

    /* Blocks first .. end-1 of SF_LANES Gaussians: M.1, M.3 (opacity compensation), M.4. */
    void (*project)(const sf_project_args *args, size_t first, size_t end);

    /* The tiles that Gaussians first .. end-1 touch: in each row of tiles, those with a column of pixel
     * centres within the visible ellipse's (o g >= 1/255) reach in that row, or a hundredth of a pixel
     * beyond. Row r of Gaussian i goes to spans[offset[i] + r], 0 <= x0 <= x1 <= tiles_x; tiles[i]: how many
     * tiles in all; depth[i]: the record's, where the Gaussian has rows. */
    void (*spans)(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,
                  const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,
                  uint32_t *tiles, float *depth);

    /* Front to back (F.5). */
    void (*blend)(const sf_blend_args *args);

    /* One row of a picture box-averaged by `factor` and taken to 0..1: dst[i] = mean of weight * src / 255
     * over factor x factor pixels, i < width. Rows of src and weight are src_stride bytes apart; weight NULL:
     * 1; src NULL: the mean weight itself. */
    void (*unpack)(const uint8_t *src, const uint8_t *weight, size_t src_stride, int factor, float *dst,
                   int width);

    /* L1 and SSIM with an 11 x 11 Gaussian window and zero padding, and the gradient (M.5). */
    void (*loss)(const sf_loss_args *args);

    /* The reverse of blend, also front to back (M.2). */
    void (*blend_bwd)(const sf_blend_args *args);

    /* What the tile would lose with each Gaussian, and what of its error each has a part in
     * (src/fit/README.md, Size). Without entry i, and all else as it is, C would be C - D_i, exactly: C is
     * linear in each alpha. */
    void (*blend_importance)(const sf_blend_args *args);

    /* Blocks first .. end-1: sums of the slots, then M.3, M.4, M.6 to the raw parameters. */
    void (*project_bwd)(const sf_project_bwd_args *args, size_t first, size_t end);

    /* One step of Adam (Kingma and Ba 2015, algorithm 1) on n parameters, n a multiple of SF_LANES. */
    void (*adam)(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step);

    /* The same step with the moments in words (above): the step is made with the new moments, which are then
     * rounded, up or down by chance, so that their mean is what they were: v changes by less than a last bit
     * a step. Parameter i takes noise = sf_noise(number + i): m is cut off after noise >> 16 is added to its
     * bits, v after noise >> 17 is. Gradients are finite. */
    void (*adam_half)(float *p, const float *g, uint32_t *moments, size_t n, const sf_adam *step,
                      uint32_t number);

    /* One step of RMSProp (Tieleman and Hinton 2012, with Adam's correction of the start) on n coefficients
     * of three channels each, n a multiple of SF_LANES: those of coefficient i are p[sf_at(i, 3, channel)],
     * and its one v[i] follows the mean square of their gradients. Where that is 0 v stays: what is not seen
     * learns nothing, and forgets nothing. step: beta1 is not used. */
    void (*rmsprop)(float *p, const float *g, float *v, size_t n, const sf_adam *step);

    /* The next six give the same bytes at all levels: each operation is rounded for itself, in one order.
     *
     * Down the columns, then along the row, with the ends' pixels repeated beyond them (S.1). */
    void (*blur)(const sf_blur_args *args);

    /* Columns whose difference is beyond the threshold and above, or below, all its 26 neighbours (S.2): of
     * equal neighbours, the first in the order of layers, rows and columns is the one. Returns how many. */
    size_t (*extrema)(const sf_extrema_args *args);

    /* Histograms of the gradients' directions about points (S.4). */
    void (*orient)(const sf_patch_args *args);

    /* Sums of gradients by place and direction (S.5), before they are normalised: direction innermost, then
     * columns of cells, then rows. */
    void (*describe)(const sf_patch_args *args);

    /* Best and second best products of each row over the columns, and of each column over the rows: keys
     * (above), exact (S.7). */
    void (*match)(const sf_match_args *args);

    /* Takes a point out of the normal equations (P.9): blocks[table[rank[i]]] -= Y^T Z[i] in double, where
     * rank[i] <= last. Entry k, l loses (Y[0][k] Z[0][l] + Y[1][k] Z[1][l]) + Y[2][k] Z[2][l]. */
    void (*schur)(const sf_schur_args *args);
} sf_kernels;

/* Enters the kernel `name` of a level into a table. */
#define SF_KERNEL_ENTER(kernels, name, at_level)                                                             \
    ((kernels)->level[SF_KERNEL_##name] = #at_level, (kernels)->name = sf_##name##_##at_level)

/* Levels, as a mask. A bit stands for every instruction that the level's files may use, and for the system
 * saving its registers: AVX2 means AVX2 and FMA; AVX512 means F, BW, DQ and VL; NEON means fused multiply-add
 * too. VNNI and DOT are no levels, but what some processors of levels AVX512 and NEON add: sums of products
 * of bytes, which the kernel `match` has files of its own for. */
enum {
    SF_CPU_SSE4 = 1,
    SF_CPU_AVX2 = 2,
    SF_CPU_AVX512 = 4,
    SF_CPU_NEON = 8,
    SF_CPU_VNNI = 16,
    SF_CPU_DOT = 32
};

/* Fills in the best kernels that `mask` allows. */
void sf_kernels_init(sf_kernels *kernels, unsigned mask);

/* The levels of this machine. */
unsigned sf_cpu_detect(void);

/* The level of that name and those below it. SF_ERR_ARGUMENT: no such level; SF_ERR_UNSUPPORTED: this machine
 * cannot run it. */
sf_status sf_cpu_choose(const char *name, unsigned *mask);

/* In arch/, one a folder: each overwrites what it does better. */
void sf_kernels_init_scalar(sf_kernels *kernels);
void sf_kernels_init_x86(sf_kernels *kernels, unsigned mask);
void sf_kernels_init_arm(sf_kernels *kernels, unsigned mask);

#endif
