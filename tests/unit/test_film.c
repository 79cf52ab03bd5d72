/* test_film.c - frames of videos that ffmpeg made of a picture that moves: which are taken, how they look,
 * and what is refused. */
#include "features_fixture.h"

#include <dirent.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/rng.h"
#include "io/picture.h"

#include <splatfit/sfm.h>

/* The window of WIDTH px moves by STEP px a frame. */
enum { WIDE = 640, WIDTH = 256, HEIGHT = 192, STEP = 4, FRAMES = 90, BLOBS = 1500 };

static uint8_t *grey;
static const double tint[3] = {0.9, 0.6, 0.35};

static int shell(const char *format, ...) {
    char command[4096], line[3600];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    snprintf(command, sizeof command, "%s >'%s' 2>&1", line, test_path("said"));
    return system(command);
}

static void need_ffmpeg(void) {
    test_skip_emulated(); /* what judges frames is in test_film_frames */
    if (shell("ffmpeg -version && ffprobe -version")) test_skip("ffmpeg is not installed");
}

/* A film of the window: `filters` begin with a comma, `options` say how it is encoded. */
static const char *make_film(const char *name, const char *filters, const char *options) {
    static char path[1024];
    snprintf(path, sizeof path, "%s", test_path(name));
    assert_int_equal(
        shell("ffmpeg -nostdin -v error -y -loop 1 -framerate 60 -i '%s' -vf \"crop=%d:%d:x='%d*n':y=0%s\" "
              "-an -frames:v %d %s '%s'",
              test_path("wide.png"), WIDTH, HEIGHT, STEP, filters, FRAMES, options, path),
        0);
    return path;
}

static int set_up(void **state) {
    (void)state;
    static test_blob blobs[BLOBS];
    static float rgb[3 * WIDE * HEIGHT];
    sf_context *ctx = test_context();
    test_scatter_blobs(3, WIDE, HEIGHT, blobs, BLOBS);
    grey = test_draw_blobs(WIDE, HEIGHT, blobs, BLOBS);
    sf_rng rng;
    sf_rng_seed(&rng, 4);
    for (size_t i = 0; i < WIDE * HEIGHT; i++) /* a texture that blur takes away */
        grey[i] = (uint8_t)(16 + grey[i] * 3 / 4 + (int)sf_rng_below(&rng, 40));
    for (size_t i = 0; i < WIDE * HEIGHT; i++)
        for (size_t c = 0; c < 3; c++) rgb[3 * i + c] = (float)(tint[c] * grey[i] / 255);
    assert_ok(ctx, sf_write_png(ctx, test_path("wide.png"), WIDE, HEIGHT, rgb));
    sf_context_destroy(&ctx);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    free(grey);
    return 0;
}

/* The numbers of the frames in a folder, ascending. Returns how many. */
static size_t numbers_in(const char *folder, int numbers[FRAMES]) {
    struct dirent **names;
    int count = scandir(folder, &names, NULL, alphasort);
    size_t n = 0;
    assert_true(count >= 0);
    for (int i = 0; i < count; i++) {
        if (n < FRAMES) n += sscanf(names[i]->d_name, "frame_%d.jpg", &numbers[n]) == 1;
        free(names[i]);
    }
    free(names);
    return n;
}

static sf_film_info take(sf_context *ctx, const char *film, const char *folder, int frames) {
    sf_film_options options = sf_film_options_default();
    sf_film_info info;
    options.frames = frames;
    assert_ok(ctx, sf_film_take_frames(ctx, film, test_path(folder), &options, &info));
    return info;
}

/* Blurred frames are passed over; the others are evenly spaced, whatever the times of the frames. */
static void test_sharp_frames(void **state) {
    (void)state;
    enum { WANTED = 15 };
    static const struct {
        const char *name, *filters, *options;
    } films[] = {{"film.mp4", ",boxblur=3:enable='mod(n,3)'", "-pix_fmt yuv420p -c:v mpeg4 -q:v 2"},
                 {"film.mkv", ",boxblur=3:enable='mod(n,3)',setpts=(2*N+mod(N\\,2)+9*floor(N/20))/(30*TB)",
                  "-pix_fmt yuv420p -c:v mpeg4 -q:v 2 -vsync vfr"}};
    need_ffmpeg();
    sf_context *ctx = test_context();
    for (size_t f = 0; f < sizeof films / sizeof *films; f++) {
        char film[1024], folder[32];
        int numbers[FRAMES];
        snprintf(film, sizeof film, "%s", make_film(films[f].name, films[f].filters, films[f].options));
        snprintf(folder, sizeof folder, "sharp%zu", f);
        assert_true(sf_film_is(film));
        sf_film_info info = take(ctx, film, folder, WANTED);
        assert_int_equal(info.frames, FRAMES);
        assert_int_equal(info.taken, WANTED);
        assert_int_equal(info.width, WIDTH);
        assert_int_equal(info.height, HEIGHT);
        assert_true(fabs(info.path * WIDTH / (STEP * (FRAMES - 1)) - 1) < 0.1);
        assert_int_equal(numbers_in(test_path(folder), numbers), WANTED);
        for (int i = 0; i < WANTED; i++) {
            assert_int_equal(numbers[i] % 3, 0);
            assert_true(!i || (numbers[i] - numbers[i - 1] >= 3 && numbers[i] - numbers[i - 1] <= 12));
        }
    }
    sf_context_destroy(&ctx);
}

/* The mean of a channel of the window at frame `number`. */
static double mean_at(int number, size_t channel) {
    double sum = 0;
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++) sum += grey[y * WIDE + x + (size_t)(STEP * number)];
    return tint[channel] * sum / (WIDTH * HEIGHT);
}

static void check_colours(sf_context *ctx, const char *folder) {
    int numbers[FRAMES];
    size_t count = numbers_in(test_path(folder), numbers);
    assert_true(count > 1);
    for (size_t i = 0; i < count; i++) {
        char name[64];
        sf_picture picture;
        snprintf(name, sizeof name, "frame_%06d.jpg", numbers[i]);
        assert_ok(ctx, sf_picture_load(ctx, test_path_in(folder, name), &picture));
        size_t pixels = (size_t)picture.width * (size_t)picture.height;
        for (size_t c = 0; c < 3; c++) {
            double sum = 0;
            for (size_t k = 0; k < pixels; k++) sum += picture.rgb[c * pixels + k];
            assert_true(fabs(sum / (double)pixels - mean_at(numbers[i], c)) < 2.5);
        }
        sf_picture_free(ctx, &picture);
    }
}

/* BT.601 and 709, said and not said, limited and full range: photos have the colours that were filmed. */
static void test_colours(void **state) {
    (void)state;
    static const struct {
        const char *name, *filters, *options;
    } films[] = {
        {"small.mp4", "", "-pix_fmt yuv420p -c:v mpeg4 -q:v 2"},
        {"said.mkv", ",scale=out_color_matrix=bt709",
         "-pix_fmt yuv420p -c:v mpeg4 -q:v 2 -colorspace bt709 -color_primaries bt709 -color_trc bt709"},
        {"wide.mp4", ",scale=1280:536:out_color_matrix=bt709", "-pix_fmt yuv420p -c:v mpeg4 -q:v 2"},
        {"large.mp4", ",scale=1280:960:out_color_matrix=bt709", "-pix_fmt yuv420p -c:v mpeg4 -q:v 2"},
        {"full.avi", "", "-c:v mjpeg -pix_fmt yuvj420p -q:v 2"}};
    need_ffmpeg();
    sf_context *ctx = test_context();
    for (size_t f = 0; f < sizeof films / sizeof *films; f++) {
        char folder[32];
        snprintf(folder, sizeof folder, "colours%zu", f);
        take(ctx, make_film(films[f].name, films[f].filters, films[f].options), folder, 3);
        check_colours(ctx, folder);
    }
    sf_context_destroy(&ctx);
}

/* A film that says it is turned, and frames that are reduced. */
static void test_size(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    sf_film_options options = sf_film_options_default();
    sf_film_info info;
    char film[1024], turned[1024];
    snprintf(film, sizeof film, "%s", make_film("size.mp4", "", "-pix_fmt yuv420p -c:v mpeg4 -q:v 2"));
    snprintf(turned, sizeof turned, "%s", test_path("turned.mp4"));
    if (shell("ffmpeg -nostdin -v error -y -display_rotation:v:0 90 -i '%s' -c copy '%s'", film, turned))
        assert_int_equal(
            shell("ffmpeg -nostdin -v error -y -i '%s' -c copy -metadata:s:v:0 rotate=90 '%s'", film, turned),
            0);
    options.frames = 4, options.side = 128;
    assert_ok(ctx, sf_film_take_frames(ctx, turned, test_path("turned"), &options, &info));
    assert_int_equal(info.width, 96);
    assert_int_equal(info.height, 128);
    assert_int_equal(test_count_entries(test_path("turned")), 4);
    sf_context_destroy(&ctx);
}

/* How rows differ from the next ones, against how they differ from those after the next, which are of the
 * same field: well below 1 where both fields are of one time. */
static double combing(sf_context *ctx, const char *path) {
    sf_picture p;
    double odd = 0, even = 0;
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    size_t width = (size_t)p.width;
    for (size_t y = 2; y + 2 < (size_t)p.height; y++)
        for (size_t x = 0; x < width; x++) {
            const uint8_t *at = p.rgb + y * width + x;
            odd += abs(at[0] - at[width]);
            even += abs(at[0] - at[2 * width]);
        }
    sf_picture_free(ctx, &p);
    return odd / even;
}

/* At which step of the window's way a picture was filmed, of those near `step`. */
static int step_of(sf_context *ctx, const char *path, int step) {
    enum { NEAR = 2 };
    sf_picture p;
    double least = HUGE_VAL;
    int best = -1;
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    assert_int_equal(p.width, WIDTH);
    assert_int_equal(p.height, HEIGHT);
    for (int s = step < NEAR ? 0 : step - NEAR; s <= step + NEAR && STEP * s <= WIDE - WIDTH; s++) {
        double sum = 0;
        for (size_t y = 8; y < HEIGHT - 8; y++)
            for (size_t x = 0; x < WIDTH; x++)
                sum += fabs(p.rgb[y * WIDTH + x] - tint[0] * grey[y * WIDE + x + (size_t)(STEP * s)]);
        if (sum < least) least = sum, best = s;
    }
    sf_picture_free(ctx, &p);
    return best;
}

static int has_encoder(const char *name) {
    return !shell("ffmpeg -nostdin -v error -f lavfi -i color=s=64x64 -frames:v 1 -c:v %s -f null -", name);
}

/* A film whose frame n holds the window's steps 2n and 2n + 1 as fields, the upper one first or the lower.
 * Who says so: `said`. */
typedef struct woven_film {
    const char *name, *scan, *options, *said;
    int has_fields; /* whether each is coded as a picture */
} woven_film;

#define X265 "-c:v libx265 -preset ultrafast -x265-params log-level=none:crf=8:interlace="

static const woven_film woven_films[] = {
    /* the stream and the frames */
    {"both.mkv", "tff", "-c:v mpeg2video -q:v 2 -flags +ildct+ilme -top 1",
     "both.mkv: is interlaced (field order tt by its stream, and 8 of its first 8 frames say)", 0},
    /* the frames alone */
    {"frames.mp4", "tff", "-c:v mpeg4 -q:v 2 -flags +ildct+ilme -top 1",
     "frames.mp4: is interlaced (as 8 of its first 8 frames say): its frames are deinterlaced", 0},
    {"frames.mov", "bff", "-c:v mpeg4 -q:v 2 -flags +ildct+ilme -top 0",
     "frames.mov: is interlaced (as 8 of its first 8 frames say)", 0},
    /* the stream alone: a decoder of JPEGs knows of no fields */
    {"stream.mkv", "tff", "-c:v mjpeg -q:v 2 -field_order tt", "(field order tt by its stream): its frames",
     0},
    {"stream.mov", "bff", "-c:v mjpeg -q:v 2 -field_order bb", "(field order bb by its stream): its frames",
     0},
};

static const woven_film hevc_films[] = {
    /* each picture that is coded is a field */
    {"fields.ts", "tff", X265 "tff",
     "fields.ts: is interlaced (as 8 of its first 8 pictures say): each two of its pictures", 1},
    {"fields.mkv", "bff", X265 "bff",
     "fields.mkv: is interlaced (as 8 of its first 8 pictures say): each two of its pictures", 1},
    /* whole frames that are said to be fields */
    {"whole.ts", "tff", X265 "tff", "whole.ts: is interlaced (as 8 of its first 8 frames say): its frames",
     0},
    {"whole.mp4", "bff", X265 "bff", "whole.mp4: is interlaced (as 8 of its first 8 frames say): its frames",
     0},
};

enum { FILM_FRAMES = 40, TAKEN = 4 };

/* With SPLATFIT_QUICK every second film: programs that start ffmpeg three times each. */
static size_t film_step(void) { return test_is_quick() ? 2 : 1; }

/* Fields that were filmed one after the other do not stay woven; frames keep their numbers and show what the
 * first field does. */
static void check_woven(sf_context *ctx, const woven_film *film) {
    char path[1024], filters[128], options[512];
    sf_film_info info;
    sf_film_options wanted = sf_film_options_default();
    int numbers[FRAMES];
    wanted.frames = TAKEN;
    snprintf(filters, sizeof filters, ",boxblur=2,interlace=scan=%s:lowpass=off%s", film->scan,
             film->has_fields ? ",separatefields" : "");
    snprintf(options, sizeof options, "-pix_fmt yuv%s420p -frames:v %d %s",
             strstr(film->options, "mjpeg") ? "j" : "", film->has_fields ? 2 * FILM_FRAMES : FILM_FRAMES,
             film->options);
    snprintf(path, sizeof path, "%s", make_film(film->name, filters, options));
    assert_true(sf_film_is(path));
    test_log_clear();
    assert_ok(ctx, sf_film_take_frames(ctx, path, test_path("woven"), &wanted, &info));
    test_assert_contains(test_log, film->said, __FILE__, __LINE__);
    assert_int_equal(info.frames, FILM_FRAMES);
    assert_int_equal(numbers_in(test_path("woven"), numbers), TAKEN);
    for (int i = 0; i < TAKEN; i++) {
        char name[64];
        snprintf(name, sizeof name, "frame_%06d.jpg", numbers[i]);
        assert_true(combing(ctx, test_path_in("woven", name)) < 0.8);
        assert_int_equal(step_of(ctx, test_path_in("woven", name), 2 * numbers[i]), 2 * numbers[i]);
    }
    assert_int_equal(shell("rm -r '%s'", test_path("woven")), 0);
}

static void test_interlaced(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    for (size_t f = 0; f < sizeof woven_films / sizeof *woven_films; f += film_step())
        check_woven(ctx, &woven_films[f]);
    sf_context_destroy(&ctx);
}

static void test_interlaced_hevc(void **state) {
    (void)state;
    need_ffmpeg();
    if (!has_encoder("libx265")) test_skip("ffmpeg has no libx265");
    sf_context *ctx = test_context();
    for (size_t f = 0; f < sizeof hevc_films / sizeof *hevc_films; f += film_step())
        check_woven(ctx, &hevc_films[f]);
    sf_context_destroy(&ctx);
}

/* Nothing is said or done of whole frames. */
static void test_whole_frames(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    const char *film = make_film("whole_frames.mp4", ",boxblur=2", "-c:v mpeg4 -q:v 2");
    test_log_clear();
    take(ctx, film, "whole_frames", TAKEN);
    assert_string_equal(test_log, "");
    sf_context_destroy(&ctx);
}

static void assert_fails(sf_context *ctx, const char *film, sf_status status, const char *part) {
    assert_status(ctx, sf_film_take_frames(ctx, film, test_path("none"), NULL, NULL), status);
    assert_error_names(ctx, part);
    assert_int_equal(test_exists(test_path("none")), 0);
    assert_int_equal(test_exists(test_path("none.part")), 0);
}

/* What holds a whole film's first bytes alone. */
static const char *cut(const char *film, const char *name, double share) {
    static char path[1024];
    size_t size;
    uint8_t *data = test_read(film, &size);
    snprintf(path, sizeof path, "%s", test_path(name));
    test_write(path, data, (size_t)(share * (double)size));
    free(data);
    return path;
}

static void test_bad_films(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    char film[1024];
    assert_fails(ctx, test_path("nowhere.mp4"), SF_ERR_IO, "nowhere.mp4: there is no such file");
    test_write(test_path("text.mp4"), "no film at all\n", 15);
    assert_fails(ctx, test_path("text.mp4"), SF_ERR_FORMAT, "text.mp4: ffmpeg cannot read it: ");
    test_write(test_path("empty.mp4"), "", 0);
    assert_fails(ctx, test_path("empty.mp4"), SF_ERR_FORMAT, "empty.mp4: ffmpeg cannot read it: ");
    snprintf(film, sizeof film, "%s", test_path("sound.mka"));
    assert_int_equal(shell("ffmpeg -nostdin -v error -y -f lavfi -i sine=d=0.2 '%s'", film), 0);
    assert_fails(ctx, film, SF_ERR_FORMAT, "sound.mka: holds no video stream");
    snprintf(film, sizeof film, "%s", test_path("still.mkv"));
    assert_int_equal(shell("ffmpeg -nostdin -v error -y -loop 1 -i '%s' -frames:v 9 -c:v mpeg4 '%s'",
                           test_path("wide.png"), film),
                     0);
    assert_fails(ctx, film, SF_ERR_EMPTY, "still.mkv: the picture hardly moves");
    assert_int_equal(
        shell("ffmpeg -nostdin -v error -y -i '%s' -frames:v 1 -c:v mpeg4 '%s'", film, test_path("one.mkv")),
        0);
    assert_fails(ctx, test_path("one.mkv"), SF_ERR_EMPTY, "one.mkv: 1 frames can be read");
    snprintf(film, sizeof film, "%s", make_film("whole.mp4", "", "-c:v mpeg4 -q:v 5"));
    assert_fails(ctx, cut(film, "cut.mp4", 0.7), SF_ERR_FORMAT, "cut.mp4: ffmpeg cannot read it: moov atom");
    snprintf(film, sizeof film, "%s", make_film("whole.mkv", "", "-c:v mpeg4 -q:v 5"));
    sf_film_info info = take(ctx, cut(film, "cut.mkv", 0.6), "cut", 0); /* what is there is used */
    assert_in_range(info.frames, FRAMES / 4, FRAMES - 1);
    assert_status(ctx, sf_film_take_frames(ctx, film, test_path("cut"), NULL, NULL), SF_ERR_IO);
    assert_error_names(ctx, "cut: is there already");
    sf_context_destroy(&ctx);
}

static int stop(void *user, sf_film_stage stage, size_t done, size_t all) {
    return stage == *(sf_film_stage *)user && done > 1 && (stage == SF_FILM_LOOK || all > 0);
}

static void test_cancel(void **state) {
    (void)state;
    need_ffmpeg();
    sf_context *ctx = test_context();
    const char *film = make_film("cancel.mp4", "", "-c:v mpeg4 -q:v 5");
    for (sf_film_stage stage = SF_FILM_LOOK; stage <= SF_FILM_TAKE; stage++) {
        sf_film_options options = sf_film_options_default();
        options.progress = stop, options.user = &stage;
        assert_int_equal(sf_film_take_frames(ctx, film, test_path("none"), &options, NULL), SF_ERR_CANCELLED);
        assert_int_equal(test_exists(test_path("none")), 0);
        assert_int_equal(test_exists(test_path("none.part")), 0);
    }
    sf_context_destroy(&ctx);
}

static void test_options(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_film_options options = sf_film_options_default();
    options.frames = 1;
    assert_status(ctx, sf_film_take_frames(ctx, "a.mp4", test_path("none"), &options, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "frames: 1 is not 0 or in 2..5000");
    options = sf_film_options_default(), options.side = 63;
    assert_status(ctx, sf_film_take_frames(ctx, "a.mp4", test_path("none"), &options, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "side: 63");
    options = sf_film_options_default(), options.quality = 101;
    assert_status(ctx, sf_film_take_frames(ctx, "a.mp4", test_path("none"), &options, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "quality: 101");
    sf_context_destroy(&ctx);
}

/* What to do where it is missing. */
static void test_no_ffmpeg(void **state) {
    (void)state;
    test_skip_emulated(); /* there the start of a program that is missing succeeds */
    sf_context *ctx = test_context();
    char *before = strdup(getenv("PATH"));
    assert_non_null(before);
    test_write(test_path("some.mp4"), "x", 1);
    mkdir(test_path("nothing"), 0777);
    assert_int_equal(setenv("PATH", test_path("nothing"), 1), 0);
    assert_fails(ctx, test_path("some.mp4"), SF_ERR_IO, "is not installed: apt install ffmpeg");
    setenv("PATH", before, 1);
    free(before);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sharp_frames),
                                       cmocka_unit_test(test_colours),
                                       cmocka_unit_test(test_size),
                                       cmocka_unit_test(test_interlaced),
                                       cmocka_unit_test(test_interlaced_hevc),
                                       cmocka_unit_test(test_whole_frames),
                                       cmocka_unit_test(test_bad_films),
                                       cmocka_unit_test(test_cancel),
                                       cmocka_unit_test(test_options),
                                       cmocka_unit_test(test_no_ffmpeg)};
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
