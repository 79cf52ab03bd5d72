/* test_film_source.c - the frames of a video as a source: their number, times, size and colours. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/source.h>

/* The grey of frame n is FIRST + STEP n. */
enum { WIDTH = 160, HEIGHT = 120, FRAMES = 24, RATE = 12, FIRST = 40, STEP = 6 };

static int shell(const char *format, ...) {
    char command[2048], line[1900];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    snprintf(command, sizeof command, "%s >/dev/null 2>&1", line);
    return system(command);
}

static void need_ffmpeg(void) {
    test_skip_emulated(); /* ffmpeg is this machine's */
    if (shell("ffmpeg -version && ffprobe -version")) test_skip("ffmpeg is not installed");
}

static const char *make_film(const char *name) {
    assert_int_equal(shell("ffmpeg -nostdin -v error -y -f lavfi -i 'color=black:s=%dx%d:r=%d,format=gray,"
                           "geq=lum=%d+%d*N' -frames:v %d -c:v mpeg4 -q:v 2 '%s'",
                           WIDTH, HEIGHT, RATE, FIRST, STEP, FRAMES, test_path(name)),
                     0);
    return test_path(name);
}

static sf_source *open_film(sf_context *ctx, const char *scheme, const char *film, const char *options) {
    char name[1200];
    sf_source *source;
    snprintf(name, sizeof name, "%s%s%s", scheme, film, options);
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    return source;
}

/* Every `step`-th frame comes, at its time, with its colour; then the end, again and again. */
static void check_frames(sf_context *ctx, sf_source *source, int width, int height, int step) {
    sf_source_info info;
    sf_frame frame;
    sf_source_describe(source, &info);
    assert_int_equal(info.width, width);
    assert_int_equal(info.height, height);
    assert_int_equal(info.frames, FRAMES / step);
    assert_true(!info.live && info.frames_per_second == 0 && !info.has_poses);
    for (int n = 0; n < FRAMES / step; n++) {
        assert_ok(ctx, sf_source_next(source, 1000, &frame));
        assert_int_equal(frame.sequence, n);
        assert_true(llabs(frame.time_ns - (int64_t)n * step * 1000000000 / RATE) < 1000);
        assert_int_equal(frame.format, SF_PIXEL_RGB24);
        const uint8_t *middle = frame.plane[0] + (size_t)(height / 2) * frame.stride[0] + 3 * (width / 2);
        assert_true(fabs((double)middle[1] - (FIRST + STEP * n * step)) <= 3); /* of which coding takes 2 */
        sf_source_release(source, &frame);
    }
    for (int i = 0; i < 2; i++) assert_int_equal(sf_source_next(source, 0, &frame), SF_ERR_END);
    sf_source_close(&source);
}

static void gives_every_frame(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    const char *film = make_film("grey.mp4");
    check_frames(ctx, open_film(ctx, "video:", film, ""), WIDTH, HEIGHT, 1);
    check_frames(ctx, open_film(ctx, "", film, ""), WIDTH, HEIGHT, 1);
    sf_context_destroy(&ctx);
}

static void gives_fewer_and_smaller_ones(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    const char *film = make_film("grey.mp4");
    check_frames(ctx, open_film(ctx, "", film, "?rate=6&side=80"), WIDTH / 2, HEIGHT / 2, 2);
    check_frames(ctx, open_film(ctx, "video:", film, "?rate=500"), WIDTH, HEIGHT, 1);
    sf_context_destroy(&ctx);
}

/* As ffmpeg turns a film that says that it lies on its side. */
static void is_turned(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    const char *film = make_film("grey.mp4"), *turned = test_path("turned.mp4");
    if (shell("ffmpeg -nostdin -v error -y -display_rotation:v:0 90 -i '%s' -c copy '%s'", film, turned))
        assert_int_equal(
            shell("ffmpeg -nostdin -v error -y -i '%s' -c copy -metadata:s:v:0 rotate=90 '%s'", film, turned),
            0);
    check_frames(ctx, open_film(ctx, "", turned, ""), HEIGHT, WIDTH, 1);
    sf_context_destroy(&ctx);
}

enum { SLOPE_WIDTH = 1280, SLOPE_HEIGHT = 720 };

/* Mean of a channel. */
static double mean_of(const uint8_t *rgb, size_t pixels, int channel) {
    double sum = 0;
    for (size_t i = 0; i < pixels; i++) sum += rgb[3 * i + (size_t)channel];
    return sum / (double)pixels;
}

/* Half as large, colours that change from place to place are as bright as before. */
static void keeps_the_brightness(void **state) {
    (void)state;
    need_ffmpeg();
    static uint8_t slope[3 * SLOPE_WIDTH * SLOPE_HEIGHT];
    sf_context *ctx = test_context();
    sf_frame frame;
    for (int y = 0, i = 0; y < SLOPE_HEIGHT; y++)
        for (int x = 0; x < SLOPE_WIDTH; x++, i += 3)
            slope[i] = (uint8_t)(20 + x * 200 / SLOPE_WIDTH), slope[i + 1] = (uint8_t)(30 + y / 4),
            slope[i + 2] = (uint8_t)(200 - x * 150 / SLOPE_WIDTH);
    FILE *file = fopen(test_path("slope.ppm"), "wb");
    assert_non_null(file);
    fprintf(file, "P6 %d %d 255\n", SLOPE_WIDTH, SLOPE_HEIGHT);
    assert_int_equal(fwrite(slope, sizeof slope, 1, file), 1);
    fclose(file);
    char film[1000];
    snprintf(film, sizeof film, "%s", test_path("slope.mkv"));
    assert_int_equal(shell("ffmpeg -nostdin -v error -y -i '%s' -vf scale=flags=accurate_rnd+full_chroma_int:"
                           "out_color_matrix=bt709 -pix_fmt yuv420p -colorspace bt709 -c:v ffv1 '%s'",
                           test_path("slope.ppm"), film),
                     0);
    sf_source *source = open_film(ctx, "", film, "?side=640");
    assert_ok(ctx, sf_source_next(source, 0, &frame));
    assert_int_equal(frame.width, SLOPE_WIDTH / 2);
    assert_int_equal(frame.height, SLOPE_HEIGHT / 2);
    assert_int_equal(frame.stride[0], 3 * frame.width);
    for (int c = 0; c < 3; c++) {
        double is = mean_of(frame.plane[0], (size_t)frame.width * (size_t)frame.height, c);
        double was = mean_of(slope, SLOPE_WIDTH * SLOPE_HEIGHT, c);
        printf("channel %d: %g, was %g\n", c, is, was);
        assert_true(fabs(is - was) < 0.8);
    }
    sf_source_release(source, &frame);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Two frames are out at a time, and both stay as they are. */
static void keeps_two_frames(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    sf_source *source = open_film(ctx, "", make_film("grey.mp4"), "");
    sf_frame a, b, c;
    assert_ok(ctx, sf_source_next(source, 0, &a));
    uint8_t first = a.plane[0][0];
    assert_ok(ctx, sf_source_next(source, 0, &b));
    assert_int_equal(sf_source_next(source, 0, &c), SF_ERR_ARGUMENT);
    assert_true(b.plane[0][0] > first && a.plane[0][0] == first);
    sf_source_release(source, &a);
    assert_ok(ctx, sf_source_next(source, 0, &c));
    assert_true(c.plane[0][0] > b.plane[0][0]);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void refuses(sf_context *ctx, const char *name, sf_status status, const char *part) {
    sf_source *source;
    assert_int_equal(sf_source_open(ctx, name, &source), status);
    assert_null(source);
    assert_error_names(ctx, part);
}

static void names_what_is_wrong(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    char name[1200];
    refuses(ctx, "video:nothing.mp4", SF_ERR_IO, "nothing.mp4: there is no such file");
    refuses(ctx, "nothing.mp4", SF_ERR_IO, "nothing.mp4: there is no such file");
    refuses(ctx, "nothing", SF_ERR_ARGUMENT, "nothing: unknown source, and no video or folder");
    refuses(ctx, test_folder(), SF_ERR_EMPTY, "holds no JPEG or PNG picture");
    snprintf(name, sizeof name, "video:%s?side=9", make_film("grey.mp4"));
    refuses(ctx, name, SF_ERR_ARGUMENT, "side");
    FILE *file = fopen(test_path("broken.mp4"), "wb");
    assert_non_null(file);
    fputs("no film", file);
    fclose(file);
    refuses(ctx, test_path("broken.mp4"), SF_ERR_FORMAT, "ffmpeg cannot read it");
    char *path = strdup(getenv("PATH"));
    snprintf(name, sizeof name, "%s", test_path("grey.mp4"));
    setenv("PATH", test_folder(), 1);
    refuses(ctx, name, SF_ERR_IO, "is not installed: apt install ffmpeg");
    setenv("PATH", path, 1);
    free(path);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gives_every_frame), cmocka_unit_test(gives_fewer_and_smaller_ones),
        cmocka_unit_test(is_turned),         cmocka_unit_test(keeps_the_brightness),
        cmocka_unit_test(keeps_two_frames),  cmocka_unit_test(names_what_is_wrong)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
