/* allocations_fixture.c - see the header. */
#include "allocations_fixture.h"

#include <stdlib.h>

#include "base/hash.h"

void allocations_note(world *w, const void *data, size_t size) { w->result = sf_hash(w->result, data, size); }

void allocations_note_file(world *w, const char *path) {
    size_t size;
    uint8_t *data = test_read(path, &size);
    allocations_note(w, data, size);
    free(data);
}

sf_status allocations_note_model(world *w, const sf_model *model) {
    size_t n = sf_model_count(model);
    float *means = malloc((n + 1) * 3 * sizeof *means);
    assert_non_null(means);
    sf_gaussians g = {.means = means};
    sf_status status = sf_model_get(model, 0, n, &g);
    allocations_note(w, means, n * 3 * sizeof *means);
    free(means);
    return status;
}

static sf_status read_frames(world *w, const char *name) {
    static float plane[3][SIDE * SIDE];
    float *const rgb[3] = {plane[0], plane[1], plane[2]};
    sf_source *source = NULL;
    sf_frame frame;
    sf_status status = sf_source_open(w->ctx, name, &source);
    while (!status && !(status = sf_source_next(source, 1000, &frame))) {
        status = sf_frame_convert(w->ctx, &frame, rgb, SIDE);
        sf_source_release(source, &frame);
        if (!status) allocations_note(w, plane, sizeof plane);
    }
    sf_source_close(&source);
    return status == SF_ERR_END ? SF_OK : status;
}

sf_status allocations_read_folder(world *w) {
    char name[1200];
    snprintf(name, sizeof name, "folder:%s", test_path("colmap/images"));
    return read_frames(w, name);
}

sf_status allocations_read_studio(world *w) {
    return read_frames(w, "sim:studio?width=16&height=16&frames=2&loop=0");
}

/* A failure leaves no file, nor half of one. */
sf_status allocations_write_video(world *w) {
    static float rgb[3 * WIDTH * HEIGHT];
    sf_video_options options = sf_video_options_default();
    const char *path = test_path("video/v.y4m");
    sf_video *video = NULL;
    options.width = WIDTH, options.height = HEIGHT;
    remove(path);
    sf_status status = sf_video_open(w->ctx, path, &options, &video);
    for (int k = 0; k < 2 && !status; k++) {
        for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) rgb[i] = (float)((i * (k + 2)) % 89) / 89;
        status = sf_video_add(video, rgb);
    }
    if (status)
        sf_video_abandon(&video);
    else
        status = sf_video_close(&video);
    assert_null(video);
    assert_int_equal(test_count_entries(test_path("video")), status ? 0 : 1);
    if (!status) allocations_note_file(w, path);
    return status;
}

sf_status allocations_remap(world *w) {
    static float in[3][WIDTH * HEIGHT], out[3][WIDTH * HEIGHT], weight[WIDTH * HEIGHT];
    float *const from[3] = {in[0], in[1], in[2]}, *const to[3] = {out[0], out[1], out[2]};
    const sf_lens lens = {.fx = 20, .fy = 20, .cx = 12, .cy = 8, .k1 = 0.1};
    sf_remap *r = NULL;
    for (int i = 0; i < WIDTH * HEIGHT; i++) in[0][i] = in[1][i] = in[2][i] = (float)(i % 31) / 31;
    sf_status status = sf_remap_create(w->ctx, &lens, WIDTH, HEIGHT, 1, &r);
    if (!status) status = sf_remap_run(r, from, WIDTH, to, WIDTH, weight);
    if (!status) allocations_note(w, out, sizeof out);
    sf_remap_destroy(&r);
    return status;
}

/* Boards in an empty picture: what is calibrated from observations, test_calibrate walks through. */
sf_status allocations_write_board(world *w) {
    static uint8_t grey[SIDE * SIDE];
    sf_board *board = NULL;
    sf_detector *detector = NULL;
    const sf_board_corner *corners;
    size_t count;
    sf_status status = sf_board_open(w->ctx, "a4-36h11", 0, &board);
    static const char *const names[] = {"b.json", "b.svg", "b.pdf"};
    for (int i = 0; i < 3 && !status; i++) {
        status = sf_board_write(w->ctx, board, test_path(names[i]));
        if (!status) allocations_note_file(w, test_path(names[i]));
    }
    sf_board_close(&board);
    if (!status) status = sf_board_open(w->ctx, test_path("b.json"), 0, &board);
    if (!status) status = sf_detector_create(w->ctx, board, 1, &detector);
    if (!status) status = sf_detector_find(detector, grey, SIDE, SIDE, SIDE, &corners, &count);
    sf_detector_destroy(&detector);
    sf_board_close(&board);
    return status == SF_ERR_UNSUPPORTED ? SF_OK : status;
}

/* Jobs: fits. */

/* Each stage of a long run, in a few steps: growth, charging, merging, validation, and all that is learned of
 * views. */
static sf_fit_options all_stages(void) {
    sf_fit_options o = sf_fit_options_default();
    o.steps = 15;
    o.plan_steps = 1000;
    o.max_gaussians = 150;
    o.init_random = 60;
    o.init = SF_INIT_RANDOM;
    o.densify_every = 2;
    o.validate = 4;
    o.merge = 0.5;
    o.exposure = o.refine_poses = o.refine_intrinsics = 1;
    o.refine_start = 0;
    o.moments = SF_MOMENTS_HALF;
    o.background = SF_BACKGROUND_AUTO;
    return o;
}

/* A step that failed was not done: the run goes on to its end. */
static sf_status run_to_the_end(world *w, sf_fitter *fitter) {
    sf_status status = sf_fitter_run(fitter, NULL, NULL);
    if (status == SF_ERR_MEMORY) assert_ok(w->ctx, sf_fitter_run(fitter, NULL, NULL));
    return status;
}

static sf_status end_fit(world *w, sf_fitter **fitter, sf_status status) {
    sf_model *model = NULL;
    if (!status) status = run_to_the_end(w, *fitter);
    if (!status) status = sf_fitter_snapshot(*fitter, &model);
    if (!status) status = allocations_note_model(w, model);
    sf_model_destroy(&model);
    sf_fitter_destroy(fitter);
    return status;
}

static sf_status fit(world *w, const sf_model *from, const sf_fit_options *options) {
    sf_fitter *fitter = NULL;
    sf_status status = sf_fitter_create(w->ctx, w->scene, from, options, &fitter);
    return end_fit(w, &fitter, status);
}

sf_status allocations_fit_all_stages(world *w) {
    sf_fit_options o = all_stages();
    return fit(w, NULL, &o);
}

sf_status allocations_fit_by_error(world *w) {
    sf_fit_options o = all_stages();
    o.densify = SF_DENSIFY_ERROR;
    o.merge = 0;
    o.steps = 8;
    return fit(w, NULL, &o);
}

sf_status allocations_fit_by_relocation(world *w) {
    sf_fit_options o = all_stages();
    o.densify = SF_DENSIFY_RELOCATE;
    o.moments = SF_MOMENTS_FLOAT;
    o.steps = 8;
    return fit(w, w->model, &o);
}

sf_status allocations_fit_from_sweep(world *w) {
    sf_fit_options o = all_stages();
    o.init = SF_INIT_SWEEP;
    o.steps = 1;
    return fit(w, NULL, &o);
}

sf_status allocations_fit_by_time(world *w) {
    sf_fit_options o = all_stages();
    o.steps = 4;
    o.time_limit = 1e6;
    return fit(w, NULL, &o);
}

sf_status allocations_resume(world *w) {
    const char *path = test_path("checkpoint");
    sf_fit_options o = all_stages();
    sf_fitter *fitter = NULL;
    sf_status status = sf_fitter_create(w->ctx, w->scene, NULL, &o, &fitter);
    for (int i = 0; i < 6 && !status; i++) status = sf_fitter_step(fitter);
    if (!status) status = sf_fitter_save(fitter, path);
    sf_fitter_destroy(&fitter);
    if (!status) status = sf_checkpoint_options(w->ctx, path, &o);
    if (!status) status = sf_fitter_load(w->ctx, w->scene, path, &o, &fitter);
    return end_fit(w, &fitter, status);
}

sf_status allocations_save_fitted_cameras(world *w) {
    sf_fit_options o = all_stages();
    sf_fitter *fitter = NULL;
    o.steps = 1;
    sf_status status = sf_fitter_create(w->ctx, w->scene, NULL, &o, &fitter);
    if (!status) status = sf_fitter_save_cameras(fitter, test_path("fitted.json"), 0);
    if (!status) allocations_note_file(w, test_path("fitted.json"));
    sf_fitter_destroy(&fitter);
    return status;
}

static sf_status prune_with(world *w, const sf_prune_options *o) {
    sf_model *pruned = NULL;
    sf_prune_result result;
    sf_status status = sf_prune(w->ctx, w->scene, w->model, o, &pruned, &result);
    if (!status) status = allocations_note_model(w, pruned);
    sf_model_destroy(&pruned);
    return status;
}

sf_status allocations_prune(world *w) {
    sf_prune_options o = sf_prune_options_default();
    o.loss = 3;
    o.refit_steps = 2;
    return prune_with(w, &o);
}

sf_status allocations_prune_to(world *w) {
    sf_prune_options o = sf_prune_options_default();
    o.keep = 10;
    return prune_with(w, &o);
}
