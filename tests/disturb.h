/* disturb.h - training views that are not what they seem: poses, focal lengths and exposures that are off,
 * and how far cameras are from the true ones. */
#ifndef TESTS_DISTURB_H
#define TESTS_DISTURB_H

#include "testing.h"

#include "base/rng.h"

enum { TEST_MOST_VIEWS = 64 };

/* From the studio's cameras to its middle, world units. */
#define TEST_STUDIO_DEPTH 4.3

/* Cameras of training views, as they are and as they are given: turned about an axis at random, moved, and
 * with other focal lengths. */
typedef struct test_cameras {
    size_t count;
    sf_camera truth[TEST_MOST_VIEWS], given[TEST_MOST_VIEWS];
    double degrees, depth, zoom; /* of the disturbance: standard deviations (depth: in TEST_STUDIO_DEPTH), and
                                    a factor of the focal lengths */
    sf_rng rng;
} test_cameras;

test_cameras test_disturbance(double degrees, double depth, double zoom);
/* A test_change; user: the test_cameras, which takes notes. */
void test_disturb(void *user, size_t number, sf_camera *camera, uint8_t *rgb);

/* The cameras of the training views as a fitter has them, as many as were disturbed. */
void test_cameras_of(sf_context *ctx, sf_scene *scene, const sf_fitter *fitter, const test_cameras *cameras,
                     sf_camera refined[TEST_MOST_VIEWS]);

/* Mean errors after the cameras are laid over the true ones by a rotation, a scale and a translation. */
typedef struct test_pose_error {
    double degrees, depths;
} test_pose_error;
test_pose_error test_pose_error_of(const sf_camera *got, const sf_camera *want, size_t n);

/* test_changes; user: not read. A camera that leaves room, so that the greatest gain below brings nothing to
 * white; and gains .7 and 1.4 of that by turns, red against blue by 15 %. */
void test_dim(void *user, size_t number, sf_camera *camera, uint8_t *rgb);
void test_wander(void *user, size_t number, sf_camera *camera, uint8_t *rgb);

/* The mean over `across` and `down` px to either side: the blur of a camera that moved or was out of focus.
 */
typedef struct test_smear {
    int across, down;
} test_smear;
/* A test_change of every third picture, the second first; user: a test_smear. */
void test_blur_a_third(void *user, size_t number, sf_camera *camera, uint8_t *rgb);

#endif
