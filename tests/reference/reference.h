/* reference.h - a renderer, its loss and all gradients in float64: what src/render/README.md says, as plainly
 * as it can be said.
 *
 * Dense: every Gaussian meets every pixel; there are no tiles, no lists and nothing is shared with src/.
 * Equations are cited as in src/render/README.md: F.* and B.* of its sources, M.* of its sections. Each step
 * forward has its twin backward. Memory that runs out fails the test in progress.
 */
#ifndef TESTS_REFERENCE_H
#define TESTS_REFERENCE_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/camera.h>

/* Raw parameters, or gradients with respect to them. K = (sh_degree + 1)^2. */
typedef struct test_ref_gaussians {
    double *means;           /* [n][3] */
    double *quats;           /* [n][4], w x y z */
    double *log_scales;      /* [n][3] */
    double *logit_opacities; /* [n] */
    double *sh;              /* [n][K][3] */
} test_ref_gaussians;

/* How the exponent of a pair is computed. */
typedef enum test_ref_form {
    TEST_REF_FLOAT64,         /* factored (M.1) */
    TEST_REF_FLOAT32,         /* the same in float32, from the covariance's factor on; forward only */
    TEST_REF_TEXTBOOK_FLOAT32 /* ac - b^2 and the conic (F.5.3) instead; forward only */
} test_ref_form;

typedef struct test_ref_scene {
    sf_camera camera;
    size_t count;
    int sh_degree;
    test_ref_gaussians gaussians;
    double background[3];
    double near_plane;
    double low_pass; /* px^2; 0: 0.3 */
    int antialiased;
    test_ref_form form;
} test_ref_scene;

/* A Gaussian on the screen. Where it is culled, only `visible` has a meaning. */
typedef struct test_ref_splat {
    int visible;
    double camera_point[3];
    double mean2d[2];
    double factor[6]; /* A, 2 x 3: cov2d = A A^T + eps I */
    double cov2d[3];  /* a, b, c: with the low-pass */
    double det;
    double conic[3]; /* w0, w1, w2: the inverse of cov2d */
    double rgb[3];
    double opacity;       /* in anti-aliased mode: compensated */
    int jacobian_clamped; /* bit 0: in x, bit 1: in y */
    int compensation_floored;
    int rgb_clamped; /* bit per channel */
} test_ref_splat;

/* How often each branch was taken: a test that means to reach one asserts that it did. */
typedef struct test_ref_counts {
    uint64_t pairs;            /* blended */
    uint64_t saturated;        /* of these, with alpha' at its greatest */
    uint64_t wide;             /* of these, with the Jacobian clamped */
    uint64_t floored;          /* of these, with the compensation at its least */
    uint64_t stopped_pixels;   /* finished early */
    uint64_t clamped_channels; /* of visible Gaussians, at 0 */
} test_ref_counts;

/* What a scene looks like. */
typedef struct test_ref_frame {
    test_ref_splat *splats; /* [n] */
    uint32_t *order;        /* [visible]: ascending z, stable */
    size_t visible;
    double *rgb;           /* [H][W][3] */
    double *transmittance; /* [H][W] */
    double *depth;         /* [H][W]: sum of w z */
    test_ref_counts counts;
    uint64_t branches; /* a hash of every decision: two frames of equal hash are on one smooth piece */
} test_ref_frame;

/* dL/d of what a splat brings to its pixels. */
typedef struct test_ref_splat_grads {
    double mean2d[2];
    double conic[3];
    double rgb[3];
    double opacity;
} test_ref_splat_grads;

typedef struct test_ref_grads {
    test_ref_gaussians gaussians;
    double pose[6];  /* rho, phi (M.6) */
    double focal[2]; /* of log fx, log fy (M.6) */
    double background[3];
} test_ref_grads;

/* n numbers, 0. free() them. */
double *test_ref_numbers(size_t n);
test_ref_gaussians test_ref_gaussians_create(size_t count, int sh_degree);
void test_ref_gaussians_free(test_ref_gaussians *gaussians);

/* The five arrays of `gaussians` by name, for loops over all of them. */
enum { TEST_REF_ARRAYS = 5 };
typedef struct test_ref_array {
    const char *name;
    double *values;
    size_t width; /* values per Gaussian */
} test_ref_array;
void test_ref_list(const test_ref_gaussians *gaussians, int sh_degree, test_ref_array list[TEST_REF_ARRAYS]);

/* The whole way, and back from d_rgb [H][W][3]. The caller frees what they give. */
void test_ref_render(const test_ref_scene *scene, test_ref_frame *frame);
void test_ref_frame_free(test_ref_frame *frame);
void test_ref_backward(const test_ref_scene *scene, const test_ref_frame *frame, const double *d_rgb,
                       test_ref_grads *grads);
void test_ref_grads_free(test_ref_grads *grads);

/* The stages of the two. Backwards, `grads` is added to; `d_splats` [n] too. */
void test_ref_project(const test_ref_scene *scene, size_t i, test_ref_splat *splat);
void test_ref_blend(const test_ref_scene *scene, test_ref_frame *frame);
void test_ref_blend_backward(const test_ref_scene *scene, const test_ref_frame *frame, const double *d_rgb,
                             test_ref_splat_grads *d_splats, double d_background[3]);
void test_ref_project_backward(const test_ref_scene *scene, size_t i, const test_ref_splat_grads *d_splat,
                               test_ref_grads *grads);

/* The basis Y_k at direction d, K values, and the gradient of its polynomials (M.4). */
void test_ref_sh_basis(int degree, const double d[3], double basis[16]);
void test_ref_sh_basis_backward(int degree, const double d[3], double d_basis[16][3]);

typedef struct test_ref_loss {
    double loss, l1, ssim;
    uint64_t branches; /* as in a frame: the signs of the differences */
} test_ref_loss;

/* Two pictures to compare, [height][width][3]; weight [height][width] or NULL for 1. */
typedef struct test_ref_pair {
    int width, height;
    const double *rgb, *target, *weight;
    double lambda;
    double delta; /* of Huber's loss; 0: L1 */
} test_ref_pair;

/* The loss (M.5) and dL/drgb, where d_rgb is not NULL. */
test_ref_loss test_ref_compare(const test_ref_pair *pair, double *d_rgb);

/* Adds one decision to a hash of branches (FNV-1a by words); start from TEST_REF_NO_BRANCH. */
#define TEST_REF_NO_BRANCH UINT64_C(0xcbf29ce484222325)
static inline uint64_t test_ref_branch(uint64_t branches, uint64_t decision) {
    return (branches ^ decision) * UINT64_C(0x100000001b3);
}

#endif
