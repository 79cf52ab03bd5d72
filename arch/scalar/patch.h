/* patch.h - the constants of the kernels orient and describe, for all levels (src/sfm/README.md, S.4, S.5).
 */
#ifndef SF_ARCH_SCALAR_PATCH_H
#define SF_ARCH_SCALAR_PATCH_H

enum { SF_GRADIENTS = 15, SF_CELLS = 4, SF_DIRECTIONS = 8 };

/* Of gradient p of a row, a Gaussian of deviation 2.5 about the middle. */
static const float sf_near_middle[SF_GRADIENTS] = {
    0.0198410947f, 0.0561347628f, 0.135335283f, 0.2780373f, 0.486752256f, 0.726149037f,  0.923116346f, 1,
    0.923116346f,  0.726149037f,  0.486752256f, 0.2780373f, 0.135335283f, 0.0561347628f, 0.0198410947f};

/* Of gradient p of a row, its share of the cells p / 3 - 1 and p / 3, those of them that are among 0..3:
 * linear in the distance from the cell's middle, times a Gaussian of deviation 6 about the patch's. */
static const float sf_cell_share[SF_GRADIENTS][2] = {{0, 0.0843892694f},
                                                     {0, 0.30326533f},
                                                     {0, 0.588873565f},
                                                     {0.667281169f, 0.133456234f},
                                                     {0.441248451f, 0.441248451f},
                                                     {0.157659911f, 0.788299557f},
                                                     {0.821839264f, 0.164367853f},
                                                     {0.5f, 0.5f},
                                                     {0.164367853f, 0.821839264f},
                                                     {0.788299557f, 0.157659911f},
                                                     {0.441248451f, 0.441248451f},
                                                     {0.133456234f, 0.667281169f},
                                                     {0.588873565f, 0},
                                                     {0.30326533f, 0},
                                                     {0.0843892694f, 0}};

/* Of the directions k d, d = 11.25 degrees: tan of the first three, and sin(k d) / sin d, cos(k d) / sin d.
 */
static const float sf_direction_tan[3] = {0.198912367f, 0.414213562f, 0.668178638f};
static const float sf_direction_sin[5] = {0, 1, 1.96157056f, 2.84775907f, 3.62450979f};
static const float sf_direction_cos[5] = {5.1258309f, 5.02733949f, 4.73565025f, 4.26197263f, 3.62450979f};

#define SF_ROOT_2 1.41421356f

#endif
