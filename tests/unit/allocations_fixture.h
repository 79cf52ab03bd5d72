/* allocations_fixture.h - jobs of the library that read frames, fit and prune, and what all jobs are compared
 * by. */
#ifndef TESTS_UNIT_ALLOCATIONS_FIXTURE_H
#define TESTS_UNIT_ALLOCATIONS_FIXTURE_H

#include "testing.h"

/* Of the pictures of sim:studio; and of those that are written here. */
enum { SIDE = 64, WIDTH = 24, HEIGHT = 16 };

/* What jobs work on: made before any allocation fails. */
typedef struct world {
    sf_context *ctx;
    test_allocations memory;
    sf_scene *scene;
    sf_model *model;
    uint64_t result; /* hash of what the job made */
} world;

/* Adds to the hash of what the job made: bytes, a file, the means of a model. */
void allocations_note(world *w, const void *data, size_t size);
void allocations_note_file(world *w, const char *path);
sf_status allocations_note_model(world *w, const sf_model *model);

/* Jobs: each returns the status of what failed first. */
sf_status allocations_read_folder(world *w);
sf_status allocations_read_studio(world *w);
sf_status allocations_write_video(world *w);
sf_status allocations_remap(world *w);
sf_status allocations_write_board(world *w);
sf_status allocations_fit_all_stages(world *w);
sf_status allocations_fit_by_error(world *w);
sf_status allocations_fit_by_relocation(world *w);
sf_status allocations_fit_from_sweep(world *w);
sf_status allocations_fit_by_time(world *w);
sf_status allocations_resume(world *w);
sf_status allocations_save_fitted_cameras(world *w);
sf_status allocations_prune(world *w);
sf_status allocations_prune_to(world *w);

#endif
