/* test_libcamera.c - names of libcamera's cameras, where there is no camera. */
#include "../testing.h"

#include <string.h>

static void expect(sf_context *ctx, const char *name, sf_status expected, const char *part) {
    sf_source *source;
    assert_status(ctx, sf_source_open(ctx, name, &source), expected);
    assert_null(source);
    assert_error_names(ctx, part);
}

#ifdef SF_HAVE_LIBCAMERA

static void test_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    expect(ctx, "libcamera:", SF_ERR_ARGUMENT, "names no camera");
    expect(ctx, "libcamera:0?size=640", SF_ERR_ARGUMENT, "\"640\"");
    expect(ctx, "libcamera:0?size=0x480", SF_ERR_ARGUMENT, "\"0x480\"");
    expect(ctx, "libcamera:0?size=640x480x2", SF_ERR_ARGUMENT, "\"640x480x2\"");
    expect(ctx, "libcamera:0?format=P010", SF_ERR_ARGUMENT, "\"P010\"");
    expect(ctx, "libcamera:0?exposure=long", SF_ERR_ARGUMENT, "\"long\"");
    expect(ctx, "libcamera:0?exposure=manual:0", SF_ERR_ARGUMENT, "\"manual:0\"");
    expect(ctx, "libcamera:0?gain=-1", SF_ERR_ARGUMENT, "gain");
    expect(ctx, "libcamera:0?buffers=2", SF_ERR_ARGUMENT, "buffers");
    expect(ctx, "libcamera:0?colour=red", SF_ERR_ARGUMENT, "\"colour\"");
    sf_context_destroy(&ctx);
}

/* libcamera is started for each, and stopped again, in one context after the other. */
static void test_absent(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = test_context();
        expect(ctx, "libcamera:no such camera", SF_ERR_IO, "\"no such camera\"");
        expect(ctx, "libcamera:1000?size=640x480", SF_ERR_IO, "\"1000\"");
        sf_devices *devices;
        assert_ok(ctx, sf_devices_find(ctx, &devices));
        sf_devices_free(&devices);
        sf_context_destroy(&ctx);
    }
}

#else

static void test_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    expect(ctx, "libcamera:0", SF_ERR_UNSUPPORTED, "without libcamera");
    sf_context_destroy(&ctx);
}

static void test_absent(void **state) {
    (void)state;
    test_skip("built without libcamera");
}

#endif

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_names), cmocka_unit_test(test_absent)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
