/* blobs.h - scenes of a given number of separate blobs, and empty pictures. */
#ifndef TESTS_BLOBS_H
#define TESTS_BLOBS_H

#include "testing.h"

/* `count` round blobs within 0.5 of the origin before black, no points, 20 training and 7 held-out views
 * of 160 by 160 px all around; or, where count is 0, pictures of one gray of 0..1, of noise where it is below
 * 0. The caller destroys it. */
sf_scene *test_blob_scene(sf_context *ctx, size_t count, double gray);

#endif
