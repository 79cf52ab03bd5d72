/* lenses.c - targets calibration, board, poses: lenses, boards and poses from files. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fuzz.h"
#include "pose/path.h"

/* A lens that was read can be used, and written and read again. JSON takes up to 100 times its text. */
static void use(sf_context *ctx, const sf_calibration *lens) {
    sf_remap *remap;
    sf_calibration again;
    const char *path = fuzz_path("again.json");
    sf_status status = sf_remap_create(ctx, &lens->lens, lens->width < 32 ? lens->width : 32,
                                       lens->height < 32 ? lens->height : 32, 1, &remap);
    fuzz_went_well(ctx, status, "");
    sf_remap_destroy(&remap);
    FUZZ_CHECK(!sf_calibration_save(ctx, lens, path), "save: %s", sf_last_error(ctx));
    FUZZ_CHECK(!sf_calibration_load(ctx, path, &again), "load: %s", sf_last_error(ctx));
    FUZZ_CHECK(again.width == lens->width && again.height == lens->height, "size: %d x %d became %d x %d",
               (int)lens->width, (int)lens->height, (int)again.width, (int)again.height);
}

int fuzz_calibration(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, 1 << 18, 128);
    const char *path = fuzz_file("lens", data, size);
    sf_calibration lens;
    int well = fuzz_went_well(ctx, sf_calibration_load(ctx, path, &lens), path);
    if (well) use(ctx, &lens);
    fuzz_end();
    return well;
}

int fuzz_board(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, 1 << 20, 128);
    const char *path = fuzz_file("board.json", data, size), *again = fuzz_path("again.json");
    sf_board *board, *other;
    int well = fuzz_went_well(ctx, sf_board_open(ctx, path, 0, &board), path);
    if (well) {
        FUZZ_CHECK(!sf_board_write(ctx, board, again), "write: %s", sf_last_error(ctx));
        FUZZ_CHECK(!sf_board_open(ctx, again, 0, &other), "read: %s", sf_last_error(ctx));
        FUZZ_CHECK(other->count == board->count, "tags: %zu became %zu", board->count, other->count);
        sf_board_close(&other);
    }
    sf_board_close(&board);
    fuzz_end();
    return well;
}

/* Each line as it would arrive. */
static void read_lines(const uint8_t *data, size_t size) {
    for (size_t at = 0; at < size;) {
        const uint8_t *end = memchr(data + at, '\n', size - at);
        size_t length = end ? (size_t)(end - data) - at : size - at;
        char line[SF_POSE_LINE], fault[SF_POSE_FAULT] = "";
        sf_timed_pose pose;
        if (length < sizeof line) {
            memcpy(line, data + at, length);
            line[length] = 0;
            sf_status status = sf_pose_line_read(line, &pose, fault);
            FUZZ_CHECK((status == SF_ERR_FORMAT) == (*fault != 0), "poses: %d, fault: %s", (int)status,
                       fault);
            for (int i = 0; status == SF_OK && i < 4; i++)
                FUZZ_CHECK(fabs(pose.quat[i]) <= 1 + 1e-9, "poses: quaternion %g", pose.quat[i]);
        }
        at += length + 1;
    }
}

/* Where a file is taken, there is a pose at its first time and at its last one. */
int fuzz_poses(const uint8_t *data, size_t size) {
    char name[1024];
    sf_path *path;
    sf_path_info info;
    double R[9], t[3];
    read_lines(data, size);
    sf_context *ctx = fuzz_begin(size, 1 << 16, 32);
    const char *file = fuzz_file("poses.txt", data, size);
    snprintf(name, sizeof name, "file:%s", file);
    int well = fuzz_went_well(ctx, sf_path_open(ctx, name, &path), file);
    if (well) {
        sf_path_describe(path, &info);
        FUZZ_CHECK(!sf_path_at(path, info.first_ns, R, t), "first: %s", sf_last_error(ctx));
        FUZZ_CHECK(!sf_path_at(path, info.last_ns, R, t), "last: %s", sf_last_error(ctx));
        FUZZ_CHECK(sf_path_at(path, info.last_ns + 1, R, t) == SF_ERR_EMPTY,
                   "there is a pose after the last");
        for (int i = 0; i < 9; i++) FUZZ_CHECK(fabs(R[i]) <= 1 + 1e-6, "R: %g", R[i]);
    }
    sf_path_close(&path);
    fuzz_end();
    return well;
}
