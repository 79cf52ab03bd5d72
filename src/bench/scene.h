/* scene.h - the scene that is measured: seeded, so that every machine measures the same work.
 *
 * Gaussians drawn on the screen (half of them in clusters, log-normal sizes, thin and round ones, faint and
 * opaque ones), each lifted to its depth as a flat Gaussian that projects to what was drawn.
 */
#ifndef BENCH_SCENE_H
#define BENCH_SCENE_H

#include "../render/workspace.h"

#include <splatfit/model.h>

enum { BENCH_SEED = 7, BENCH_WIDTH = 480, BENCH_HEIGHT = 270, BENCH_GAUSSIANS = 100000 };

#define BENCH_NEAR 0.2f /* near plane of the scene's camera */

typedef struct bench_scene {
    sf_context *ctx;
    sf_model *model; /* SH of degree 3 */
    sf_camera camera;
    uint8_t *picture; /* [3][height][width], something to compare with */
} bench_scene;

sf_status bench_scene_create(sf_context *ctx, size_t gaussians, int width, int height, uint64_t seed,
                             bench_scene *scene);
void bench_scene_destroy(bench_scene *scene);

/* Projects and bins the scene into a workspace, and makes room for all later stages. */
sf_status bench_scene_project(const bench_scene *scene, sf_workspace *ws);

/* How much blending a workspace's lists are, counted in float64: pairs of a Gaussian and a pixel that
 * contribute to the picture, and those that are evaluated where a tile is cut into blocks of columns x rows
 * px and each Gaussian is evaluated in all pixels of the unfinished blocks that it reaches. */
typedef struct bench_pairs {
    double contributing, evaluated;
} bench_pairs;

bench_pairs bench_count_pairs(const sf_workspace *ws, int columns, int rows);

#endif
