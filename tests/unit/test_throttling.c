/* test_throttling.c - what the kernel says of a hot processor, as folders of a /sys; and what a live fit
 * makes of it. */
#include "../testing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "base/clock.h"
#include "live/throttling.h"

#define THERMAL "sys/class/thermal/"

static void put(const char *name, const char *text) {
    char path[256];
    snprintf(path, sizeof path, "%s", name);
    for (char *c = path; (c = strchr(c, '/')); c++) {
        *c = 0;
        mkdir(test_path(path), 0777);
        *c = '/';
    }
    test_write(test_path(name), text, strlen(text));
}

static int is_hot(const char *expected) {
    char what[128] = "nothing";
    int hot = sf_is_throttled(test_path("sys"), what, sizeof what);
    assert_string_equal(what, hot ? expected : "nothing");
    return hot;
}

static void test_nothing_is_told(void **state) {
    (void)state;
    assert_false(is_hot(""));
    put(THERMAL "thermal_zone0/type", "acpitz\n");
    assert_false(is_hot(""));
    put(THERMAL "thermal_zone0/temp", "not a number\n");
    assert_false(is_hot(""));
}

static void test_cooling_devices(void **state) {
    (void)state;
    put(THERMAL "cooling_device0/type", "Fan\n");
    put(THERMAL "cooling_device0/cur_state", "3\n");
    put(THERMAL "cooling_device1/type", "cpufreq-cpu0\n");
    put(THERMAL "cooling_device1/cur_state", "0\n");
    assert_false(is_hot(""));
    put(THERMAL "cooling_device1/cur_state", "2\n");
    assert_true(is_hot("cooling_device1 (cpufreq-cpu0): state 2"));
    put(THERMAL "cooling_device1/type", "Processor\n");
    assert_true(is_hot("cooling_device1 (Processor): state 2"));
    put(THERMAL "cooling_device1/cur_state", "-1\n"); /* of a device that is off */
    assert_false(is_hot(""));
}

static void test_zones(void **state) {
    (void)state;
    put(THERMAL "thermal_zone0/temp", "84900\n");
    put(THERMAL "thermal_zone0/trip_point_0_type", "critical\n");
    put(THERMAL "thermal_zone0/trip_point_0_temp", "60000\n");
    put(THERMAL "thermal_zone0/trip_point_1_type", "passive\n");
    put(THERMAL "thermal_zone0/trip_point_1_temp", "85000\n");
    assert_false(is_hot(""));
    put(THERMAL "thermal_zone0/temp", "85100\n");
    assert_true(is_hot("thermal_zone0: 85.1 degrees, 85.0 at most"));
    put(THERMAL "thermal_zone0/trip_point_1_temp", "-274000\n"); /* of a trip point that is not set */
    assert_false(is_hot(""));
}

static void test_firmware(void **state) {
    (void)state;
    const char *name = "sys/devices/platform/soc/soc:firmware/get_throttled";
    put(name, "50001\n"); /* the voltage is low; it was throttled once */
    assert_false(is_hot(""));
    put(name, "50004\n");
    assert_true(is_hot("get_throttled: 50004"));
    put(name, "0\n");
    assert_false(is_hot(""));
}

/* The fit rests while it is hot, and works again after; frames are looked at throughout. */
static void test_fit_rests(void **state) {
    (void)state;
    test_skip_emulated();
    enum { MOST_SECONDS = 60 };
    sf_context *ctx = test_context_threads(1), *source_ctx = test_context_threads(1);
    sf_live_options options = sf_live_options_default();
    sf_live_progress p;
    sf_source *source;
    sf_live *live;
    char folder[256];
    snprintf(folder, sizeof folder, "%s", test_path("sys"));
    options.own_poses = 1;
    options.thermal = folder;
    options.fit.max_gaussians = 1500;
    put(THERMAL "cooling_device1/type", "Processor\n");
    put(THERMAL "cooling_device1/cur_state", "1\n");
    assert_ok(source_ctx,
              sf_source_open(source_ctx, "sim:studio?width=64&height=48&fps=15&frames=10000", &source));
    assert_ok(ctx, sf_live_create(ctx, source, &options, &live));
    double began = sf_clock();
    do {
        assert_ok(ctx, sf_live_step(live));
        sf_live_get_progress(live, &p);
    } while (p.duty > 0.5 && sf_clock() - began < MOST_SECONDS);
    assert_true(p.has_fit && p.duty < 0.5 && p.duty > 0.4); /* 0.7 of 0.7 */
    uint64_t looked_at = p.looked_at;
    put(THERMAL "cooling_device1/cur_state", "0\n");
    do {
        assert_ok(ctx, sf_live_step(live));
        sf_live_get_progress(live, &p);
    } while (p.duty < 0.6 && sf_clock() - began < 2 * MOST_SECONDS);
    assert_true(p.duty > 0.6 && p.duty < 0.7); /* 0.49 times 1.15, twice */
    assert_true(p.looked_at > looked_at + 10);
    sf_live_destroy(&live);
    sf_source_close(&source);
    sf_context_destroy(&source_ctx);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nothing_is_told), cmocka_unit_test(test_cooling_devices),
        cmocka_unit_test(test_zones),           cmocka_unit_test(test_firmware),
        cmocka_unit_test(test_fit_rests),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
