/* texture.c - linear light on a rectangle, at several sizes. */
#include "texture.h"

sf_status sf_texture_create(sf_context *ctx, int width, int height, sf_texture *t) {
    size_t texels = 0;
    t->scale_u = 1 / t->width;
    t->scale_v = 1 / t->height;
    for (t->levels = 0; t->levels < SF_TEXTURE_LEVELS; t->levels++) {
        t->level[t->levels].width = width;
        t->level[t->levels].height = height;
        texels += (size_t)width * (size_t)height;
        if (width == 1 && height == 1) {
            t->levels++;
            break;
        }
        width = (width + 1) / 2;
        height = (height + 1) / 2;
    }
    uint64_t *block = sf_alloc(ctx, texels, sizeof *block);
    if (!block) return SF_ERR_MEMORY;
    for (int i = 0; i < t->levels; i++) {
        t->level[i].texels = block;
        block += (size_t)t->level[i].width * (size_t)t->level[i].height;
    }
    return SF_OK;
}

static uint64_t code(double light) {
    return (uint64_t)(lesser(light, SF_TEXTURE_MOST) * (65535 / SF_TEXTURE_MOST) + 0.5);
}

void sf_texture_put(sf_texture *t, int x, int y, sf_vec3 light) {
    t->level[0].texels[(size_t)y * (size_t)t->level[0].width + (size_t)x] =
        code(light.x) | code(light.y) << 16 | code(light.z) << 32;
}

/* Two of the colours of a texel, in lanes of 32 bits. */
static uint64_t lanes(uint64_t texel, int shift) { return texel >> shift & SF_TEXTURE_LANES; }

static uint64_t mean(uint64_t a, uint64_t b, uint64_t c, uint64_t d, int shift) {
    const uint64_t half = 0x0000000200000002u;
    uint64_t sum = lanes(a, shift) + lanes(b, shift) + lanes(c, shift) + lanes(d, shift) + half;
    return (sum >> 2 & SF_TEXTURE_LANES) << shift;
}

static void reduce(sf_texture *t, int level) {
    int width = t->level[level - 1].width, height = t->level[level - 1].height;
    const uint64_t *from = t->level[level - 1].texels;
    uint64_t *to = t->level[level].texels;
    for (int y = 0; y < height; y += 2)
        for (int x = 0; x < width; x += 2) {
            const uint64_t *a = from + (size_t)y * (size_t)width + (size_t)x, *b = a + (x + 1 < width);
            size_t down = y + 1 < height ? (size_t)width : 0;
            *to++ = mean(*a, *b, a[down], b[down], 0) | mean(*a, *b, a[down], b[down], 16);
        }
}

void sf_texture_reduce(sf_texture *t) {
    for (int i = 1; i < t->levels; i++) reduce(t, i);
}
