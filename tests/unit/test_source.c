/* test_source.c - frame sources: names, options, leases. */
#include "source_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/sim.h"

static void test_describe(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *source = source_open_source(ctx, "sim:studio");
    sf_source_info info;
    sf_source_describe(source, &info);
    assert_int_equal(info.width, 320);
    assert_int_equal(info.height, 240);
    assert_int_equal(info.format, SF_PIXEL_RGB24);
    assert_int_equal(info.frames, 60);
    assert_true(info.has_poses);
    assert_true(info.frames_per_second == 0);
    test_assert_contains(info.name, "studio", __FILE__, __LINE__);
    sf_source_close(&source);
    assert_null(source);
    sf_source_close(&source);

    source = source_open_source(
        ctx, "sim:studio?frames=7&width=32&fov=60.5&width=64&height=48&seed=9007199254740992");
    sf_source_describe(source, &info);
    assert_int_equal(info.width, 64);
    assert_int_equal(info.height, 48);
    assert_int_equal(info.frames, 7);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Frames come in order, 1/30 s apart, each with the camera of the path, and then end for good. */
static void test_frames(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *source = source_open_source(ctx, TINY "&frames=4&fov=60");
    sf_sim sim;
    sf_frame frame;
    assert_ok(ctx, sf_sim_init(ctx, TINY "&frames=4&fov=60", &sim));
    for (uint64_t i = 0; i < 4; i++) {
        sf_camera camera;
        assert_ok(ctx, sf_source_next(source, i & 1 ? 0 : -1, &frame));
        sf_sim_camera(&sim, i, &camera);
        assert_int_equal(frame.sequence, i);
        assert_int_equal(frame.time_ns, i * 1000000000 / 30);
        assert_int_equal(frame.width, 32);
        assert_int_equal(frame.height, 24);
        assert_int_equal(frame.format, SF_PIXEL_RGB24);
        assert_true(frame.stride[0] >= 3 * 32);
        assert_true(frame.has_camera);
        assert_memory_equal(frame.camera.R_cw, camera.R_cw, sizeof camera.R_cw);
        assert_memory_equal(frame.camera.t_cw, camera.t_cw, sizeof camera.t_cw);
        assert_ok(ctx, sf_camera_check(&frame.camera));
        assert_true(fabs(frame.camera.fx - 16 / tan(30 * 3.141592653589793 / 180)) < 1e-9);
        assert_true(frame.camera.fy == frame.camera.fx);
        assert_true(frame.camera.cx == 16 && frame.camera.cy == 12);
        sf_source_release(source, &frame);
    }
    for (int i = 0; i < 2; i++) assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
    assert_null(frame.plane[0]);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* The path looks at the middle of the scene from all sides of an arc of 200 degrees, at rising heights,
 * slowly. */
static void test_camera_path(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim;
    assert_ok(ctx, sf_sim_init(ctx, "sim:studio?seed=3", &sim));
    double least = 10, most = -10, last[3] = {0, 0, 0};
    double low = 10, high = 0;
    for (uint64_t i = 0; i <= sim.frames; i++) {
        sf_camera camera;
        double c[3];
        sf_sim_camera(&sim, i % sim.frames, &camera);
        assert_ok(ctx, sf_camera_check(&camera));
        sf_camera_center(&camera, c);
        double azimuth = atan2(c[0], -c[1]);
        least = lesser(least, azimuth), most = greater(most, azimuth);
        low = lesser(low, c[2]), high = greater(high, c[2]);
        double across = camera.R_cw[0] * c[0] + camera.R_cw[1] * c[1] + camera.R_cw[2] * (c[2] - 0.8);
        assert_true(fabs(across) < 0.2); /* the scene's axis is in the middle of the picture */
        if (i) assert_true(vlength(vsub(vec3(c[0], c[1], c[2]), vec3(last[0], last[1], last[2]))) < 1);
        memcpy(last, c, sizeof last);
    }
    assert_true(least < -1.7 && most > 1.7 && least > -1.8 && most < 1.8);
    assert_true(low > 1.5 && low < 2 && high > 3 && high < 4);
    sf_context_destroy(&ctx);
}

static uint8_t *first_frame(int threads, const char *name) {
    sf_context *ctx = test_context_threads(threads);
    sf_source *source = source_open_source(ctx, name);
    sf_frame frame;
    uint8_t *copy = malloc(3 * 32 * 24);
    assert_non_null(copy);
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    for (size_t y = 0; y < 24; y++) memcpy(copy + y * 96, frame.plane[0] + y * frame.stride[0], 96);
    sf_source_release(source, &frame);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
    return copy;
}

static void test_same_seed_same_bytes(void **state) {
    (void)state;
    uint8_t *a = first_frame(1, TINY "&seed=5"), *b = first_frame(2, TINY "&seed=5");
    uint8_t *c = first_frame(4, TINY "&seed=5"), *d = first_frame(2, TINY "&seed=6");
    assert_memory_equal(a, b, 3 * 32 * 24);
    assert_memory_equal(a, c, 3 * 32 * 24);
    assert_memory_not_equal(a, d, 3 * 32 * 24);
    free(a), free(b), free(c), free(d);
}

static void test_leases(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *source = source_open_source(ctx, TINY "&frames=5");
    sf_frame a, b, c, nothing = {0};
    uint8_t row[96];
    assert_ok(ctx, sf_source_next(source, -1, &a));
    memcpy(row, a.plane[0] + 12 * a.stride[0], sizeof row);
    assert_ok(ctx, sf_source_next(source, -1, &b));
    assert_ptr_not_equal(a.plane[0], b.plane[0]);
    assert_memory_equal(row, a.plane[0] + 12 * a.stride[0], sizeof row);
    assert_status(ctx, sf_source_next(source, -1, &c), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "2 frames are out");
    assert_null(c.plane[0]);

    sf_source_release(source, &c);
    sf_source_release(source, &nothing);
    assert_status(ctx, sf_source_next(source, -1, &c), SF_ERR_ARGUMENT);

    memcpy(row, b.plane[0] + 12 * b.stride[0], sizeof row);
    sf_source_release(source, &a);
    assert_null(a.plane[0]);
    sf_source_release(source, &a); /* a second time does nothing */
    assert_ok(ctx, sf_source_next(source, -1, &c));
    assert_int_equal(c.sequence, 2); /* the refused calls cost no frame */
    assert_memory_equal(row, b.plane[0] + 12 * b.stride[0], sizeof row);
    sf_source_release(source, &b);
    assert_status(ctx, sf_source_next(source, -2, &b), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "timeout_ms: -2");
    sf_source_close(&source); /* with c still out */
    sf_context_destroy(&ctx);
}

static void test_bad_names(void **state) {
    (void)state;
    static const struct {
        const char *name, *part;
    } bad[] = {
        {"", "unknown source"},
        {"studio", "studio: unknown source"},
        {"v4m2:/dev/video0", "v4m2:/dev/video0: unknown source"},
        {"sim:", "unknown simulated scene"},
        {"sim:kitchen", "sim:kitchen: unknown simulated scene"},
        {"sim:studios", "unknown simulated scene"},
        {"sim:studi?width=64", "unknown simulated scene"},
        {"sim:studio?", "unknown option \"\""},
        {"sim:studio?depth=3", "unknown option \"depth\""},
        {"sim:studio?wid=64", "unknown option \"wid\""},
        {"sim:studio?width=64&&height=48", "unknown option \"\""},
        {"sim:studio?width=64&Height=48", "unknown option \"Height\""},
        {"sim:studio?width", "width: \"\" is not a number"},
        {"sim:studio?width=", "width: \"\" is not a number"},
        {"sim:studio?width=&height=48", "width: \"\" is not a number"},
        {"sim:studio?width=wide", "width: \"wide\" is not a number"},
        {"sim:studio?width=64px", "width: \"64px\" is not a number"},
        {"sim:studio?width=0x40", "width: \"0x40\" is not a number"},
        {"sim:studio?width=nan", "width: \"nan\" is not a number"},
        {"sim:studio?width=6-4", "width: \"6-4\" is not a number"},
        {"sim:studio?width=1=2", "width: \"1=2\" is not a number"},
        {"sim:studio?width=00000000000000000000000000000000000064", "is not a number"},
        {"sim:studio?width=15", "width: 15 is not a whole number from 16 to 4096"},
        {"sim:studio?width=4097", "width: 4097 "},
        {"sim:studio?height=-240", "height: -240 "},
        {"sim:studio?height=64.5", "height: 64.5 is not a whole number"},
        {"sim:studio?frames=0", "frames: 0 is not"},
        {"sim:studio?frames=10001", "frames: 10001 "},
        {"sim:studio?frames=99999999999999999999", "frames: 99999999999999999999 "},
        {"sim:studio?seed=-1", "seed: -1 "},
        {"sim:studio?seed=9007199254740993000", "seed: 9007199254740993000 "},
        {"sim:studio?fov=9.9", "fov: 9.9 is not a number from 10 to 120"},
        {"sim:studio?fov=121", "fov: 121 "},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_source *source = (sf_source *)ctx;
        sf_scene *scene;
        assert_status(ctx, sf_source_open(ctx, bad[i].name, &source), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_error_names(ctx, bad[i].name);
        assert_null(source);
        if (strncmp(bad[i].name, "sim:", 4) != 0) continue;
        assert_status(ctx, sf_scene_load(ctx, bad[i].name, NULL, &scene), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_null(scene);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_describe),    cmocka_unit_test(test_frames),
        cmocka_unit_test(test_camera_path), cmocka_unit_test(test_same_seed_same_bytes),
        cmocka_unit_test(test_leases),      cmocka_unit_test(test_bad_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
