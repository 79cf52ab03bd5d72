/* frame_quality.c - see frame_quality.h. */
#include "frame_quality.h"

#include <math.h>

/* Weight of a frame in the averages; of a blurred one. */
#define USUAL_MEMORY 0.05
#define BLUR_MEMORY  0.004
/* Parts of the averages of detail and sharpness, below which a frame is blurred. */
#define SHARP_ENOUGH 0.5
#define DULL         0.4

double sf_picture_sharpness(const sf_picture *p) {
    size_t width = (size_t)p->camera.width, height = (size_t)p->camera.height;
    double edges = 0, sum = 0, squares = 0, count = 0;
    for (size_t y = 2; y + 2 < height; y += 2)
        for (size_t x = 2; x + 2 < width; x += 2, count++) {
            size_t at = y * width + x;
            double g = (double)sf_picture_grey(p, at);
            double l = 4 * g - (double)(sf_picture_grey(p, at - 2) + sf_picture_grey(p, at + 2)) -
                       (double)(sf_picture_grey(p, at - 2 * width) + sf_picture_grey(p, at + 2 * width));
            edges += l * l, sum += g, squares += g * g;
        }
    double variance = count > 0 ? squares / count - pow(sum / count, 2) : 0;
    return variance > 1e-6 ? edges / count / variance : 0;
}

double sf_picture_contrast(const sf_picture *p) {
    enum { ACROSS = 32, DOWN = 24, CELLS = ACROSS * DOWN };
    size_t width = (size_t)p->camera.width, height = (size_t)p->camera.height;
    double mean = 0, squares = 0;
    for (size_t cell = 0; cell < CELLS; cell++) {
        size_t x0 = cell % ACROSS * width / ACROSS, x1 = (cell % ACROSS + 1) * width / ACROSS;
        size_t y0 = cell / ACROSS * height / DOWN, y1 = (cell / ACROSS + 1) * height / DOWN;
        float sum = 0, count = 0;
        for (size_t y = y0; y < y1; y++)
            for (size_t x = x0; x < x1; x++, count++) sum += sf_picture_grey(p, y * width + x);
        double grey = count > 0 ? (double)(sum / count) : 0;
        mean += grey / CELLS, squares += grey * grey / CELLS;
    }
    return sqrt(fmax(squares - mean * mean, 0));
}

/* Two measures of blur: sharpness next to that of the frames before, and detail in that of the model where
 * the frame was tracked. A wall has little of the first, and new ground may have little detail in the model:
 * both must fall for blur to begin; the first alone decides when it is over. Blurred frames change the
 * averages slowly: the lens itself may be blurred for good. */
void sf_judge_sharpness(sf_frame_quality *quality, const sf_track *track) {
    double usual = quality->usual_sharpness > 0 ? quality->usual_sharpness : quality->sharpness;
    double usual_detail = quality->usual_detail > 0 || !track ? quality->usual_detail : track->detail;
    if (quality->blank) return;
    int dull = quality->sharpness < DULL * usual;
    int begins = track && track->detail < SHARP_ENOUGH * usual_detail;
    quality->blurred = dull && (quality->blurred || begins) ? quality->blurred + 1 : 0;
    quality->usual_sharpness =
        usual + (quality->blurred ? BLUR_MEMORY : USUAL_MEMORY) * (quality->sharpness - usual);
    quality->relative_sharpness = quality->sharpness / fmax(usual, 1e-9);
    if (track && !quality->blurred)
        quality->usual_detail = usual_detail + USUAL_MEMORY * (track->detail - usual_detail);
}

void sf_note_trouble(sf_context *ctx, sf_frame_quality *quality) {
    static const char *const words[SF_LIVE_TROUBLE_COUNT] = {
        [SF_LIVE_BLANK] = "nothing is to be seen: is the lens covered?",
        [SF_LIVE_BLURRED] = "the pictures are blurred: they are not fitted"};
    sf_live_trouble before = quality->trouble;
    quality->trouble = quality->blank >= SF_TROUBLE_FRAMES     ? SF_LIVE_BLANK
                       : quality->blurred >= SF_TROUBLE_FRAMES ? SF_LIVE_BLURRED
                                                               : SF_LIVE_FINE;
    if (quality->trouble != before && words[quality->trouble])
        sf_log(ctx, SF_LOG_WARNING, "%s", words[quality->trouble]);
}
