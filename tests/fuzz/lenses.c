/* lenses.c - targets calibration, board: lenses and boards from files. */
#include <string.h>

#include "fuzz.h"

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
