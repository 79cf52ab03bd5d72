/* place_recognition.c - see place_recognition.h. */
#include "place_recognition.h"

#include <math.h>

double sf_make_thumbnail(const sf_picture *p, float thumbnail[SF_THUMBNAIL]) {
    size_t width = (size_t)p->camera.width, height = (size_t)p->camera.height;
    double mean = 0, squares = 0;
    for (size_t ty = 0; ty < SF_THUMBNAIL_HEIGHT; ty++)
        for (size_t tx = 0; tx < SF_THUMBNAIL_WIDTH; tx++) {
            size_t x0 = tx * width / SF_THUMBNAIL_WIDTH, x1 = (tx + 1) * width / SF_THUMBNAIL_WIDTH;
            size_t y0 = ty * height / SF_THUMBNAIL_HEIGHT, y1 = (ty + 1) * height / SF_THUMBNAIL_HEIGHT;
            float sum = 0, count = 0;
            for (size_t y = y0; y < y1; y++)
                for (size_t x = x0; x < x1; x++, count++) sum += sf_picture_grey(p, y * width + x);
            thumbnail[ty * SF_THUMBNAIL_WIDTH + tx] = count > 0 ? sum / count : 0;
            mean += (double)thumbnail[ty * SF_THUMBNAIL_WIDTH + tx] / SF_THUMBNAIL;
        }
    for (int i = 0; i < SF_THUMBNAIL; i++) squares += pow((double)thumbnail[i] - mean, 2);
    for (int i = 0; i < SF_THUMBNAIL; i++)
        thumbnail[i] = squares > 1e-9 ? (float)(((double)thumbnail[i] - mean) / sqrt(squares)) : 0;
    return sqrt(squares / SF_THUMBNAIL);
}

static double likeness(const float *a, const float *b) {
    double sum = 0;
    for (int i = 0; i < SF_THUMBNAIL; i++) sum += (double)(a[i] * b[i]);
    return sum;
}

const sf_keyframe *sf_recognize_place(const sf_keyframes *keyframes, const float thumbnail[SF_THUMBNAIL],
                                      int rank) {
    double below = INFINITY;
    const sf_keyframe *found = NULL;
    for (int r = 0; r <= rank; r++) {
        double most = -INFINITY;
        found = NULL;
        for (size_t i = 0; i < keyframes->count; i++) {
            double like = likeness(thumbnail, keyframes->list[i].thumbnail);
            if (like < below && like > most) most = like, found = &keyframes->list[i];
        }
        below = most;
    }
    return found;
}
