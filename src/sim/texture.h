/* texture.h - linear light on a rectangle, at several sizes. */
#ifndef SF_SIM_TEXTURE_H
#define SF_SIM_TEXTURE_H

#include <stddef.h>
#include <string.h>

#include "../base/context.h"
#include "vec3.h"

enum { SF_TEXTURE_LEVELS = 13 };

/* Light up to SF_TEXTURE_MOST in 16 bits: its steps are a third of one of 8 bits by the sRGB curve, at black.
 */
#define SF_TEXTURE_MOST 6.0

typedef struct sf_texture {
    double left, bottom, width, height; /* the rectangle in u, v */
    double scale_u, scale_v;            /* 1 / width, 1 / height */
    double per_square;                  /* 1 / the square of a texel's width in world units */
    int levels;
    struct {
        int width, height; /* texels: half of the level before, rounded up */
        uint64_t *texels;  /* [height][width]: red, green, blue in 16 bits each, lowest first */
    } level[SF_TEXTURE_LEVELS];
} sf_texture;

/* Memory for all levels of width x height texels; the rectangle stays as it is. The whole is one block:
 * sf_free(level[0].texels). */
sf_status sf_texture_create(sf_context *ctx, int width, int height, sf_texture *texture);

void sf_texture_put(sf_texture *texture, int x, int y, sf_vec3 light);

/* Fills the smaller levels: means of 2 x 2. */
void sf_texture_reduce(sf_texture *texture);

/* The level whose texels are at most `size` world units wide, or the finest: floor(log2(size / texel)), read
 * from the bits of the square. */
static inline int sf_texture_level(const sf_texture *t, double size_squared) {
    double ratio = size_squared * t->per_square;
    uint64_t bits;
    memcpy(&bits, &ratio, sizeof bits);
    int level = ((int)(bits >> 52) - 1023) / 2;
    return level < 0 ? 0 : level < t->levels ? level : t->levels - 1;
}

/* A sum of up to SF_TEXTURE_SAMPLES samples, two colours a word: 16 bits and 12 of weights in 32. */
enum { SF_TEXTURE_SAMPLES = 16, SF_TEXTURE_PARTS = 64 };
#define SF_TEXTURE_LANES 0x0000ffff0000ffffu

typedef struct sf_texture_sum {
    uint64_t red_blue, green;
} sf_texture_sum;

/* Adds what is at u, v, between texels. */
static inline void sf_texture_add(const sf_texture *t, int level, double u, double v, sf_texture_sum *sum) {
    int width = t->level[level].width, height = t->level[level].height;
    int x = (int)((u - t->left) * t->scale_u * (width * SF_TEXTURE_PARTS)) - SF_TEXTURE_PARTS / 2;
    int y = (int)((v - t->bottom) * t->scale_v * (height * SF_TEXTURE_PARTS)) - SF_TEXTURE_PARTS / 2;
    int right = (width - 1) * SF_TEXTURE_PARTS, top = (height - 1) * SF_TEXTURE_PARTS;
    x = x < 0 ? 0 : x > right ? right : x;
    y = y < 0 ? 0 : y > top ? top : y;
    const uint64_t *a =
        t->level[level].texels + (size_t)(y / SF_TEXTURE_PARTS) * (size_t)width + x / SF_TEXTURE_PARTS;
    const uint64_t *b = a + (x < right), *c = a + (y < top ? width : 0), *d = c + (x < right);
    uint32_t s = (uint32_t)x % SF_TEXTURE_PARTS, r = (uint32_t)y % SF_TEXTURE_PARTS;
    uint32_t wa = (SF_TEXTURE_PARTS - s) * (SF_TEXTURE_PARTS - r), wb = s * (SF_TEXTURE_PARTS - r);
    uint32_t wc = (SF_TEXTURE_PARTS - s) * r, wd = s * r;
    sum->red_blue += (*a & SF_TEXTURE_LANES) * wa + (*b & SF_TEXTURE_LANES) * wb +
                     (*c & SF_TEXTURE_LANES) * wc + (*d & SF_TEXTURE_LANES) * wd;
    sum->green += (*a >> 16 & 0xffff) * wa + (*b >> 16 & 0xffff) * wb + (*c >> 16 & 0xffff) * wc +
                  (*d >> 16 & 0xffff) * wd;
}

/* Adds a sum of `samples` times `weight` to a colour. */
static inline void sf_texture_mix(const sf_texture_sum *sum, int samples, float weight, float rgb[3]) {
    float scale =
        weight * (float)(SF_TEXTURE_MOST / 65535 / (SF_TEXTURE_PARTS * SF_TEXTURE_PARTS)) / (float)samples;
    rgb[0] += scale * (float)(uint32_t)sum->red_blue;
    rgb[1] += scale * (float)(uint32_t)sum->green;
    rgb[2] += scale * (float)(uint32_t)(sum->red_blue >> 32);
}

#endif
