/* pixel.c - see pixel.h. ITU-R BT.601, 709 and 2020: Y = Kr R + Kg G + Kb B, Pb = (B - Y) / (2 - 2 Kb),
 * Pr = (R - Y) / (2 - 2 Kr), solved for R, G and B. */
#include "pixel.h"

static int sample(const sf_frame *f, int plane, int32_t column, int32_t row) {
    return f->plane[plane][(size_t)row * f->stride[plane] + (size_t)column];
}

/* Y, Cb, Cr of a pixel; Cb and Cr 128 where the format has none. */
static void samples_at(const sf_frame *f, int32_t x, int32_t y, int s[3]) {
    int32_t pair = x / 2;
    s[1] = s[2] = 128;
    switch (f->format) {
    case SF_PIXEL_YUYV:
        s[0] = sample(f, 0, 2 * x, y);
        s[1] = sample(f, 0, 4 * pair + 1, y);
        s[2] = sample(f, 0, 4 * pair + 3, y);
        return;
    case SF_PIXEL_UYVY:
        s[0] = sample(f, 0, 2 * x + 1, y);
        s[1] = sample(f, 0, 4 * pair, y);
        s[2] = sample(f, 0, 4 * pair + 2, y);
        return;
    case SF_PIXEL_NV12:
        s[1] = sample(f, 1, 2 * pair, y / 2);
        s[2] = sample(f, 1, 2 * pair + 1, y / 2);
        break;
    case SF_PIXEL_YU12:
        for (int c = 1; c < 3; c++) s[c] = sample(f, c, pair, y / 2);
        break;
    case SF_PIXEL_422P:
        for (int c = 1; c < 3; c++) s[c] = sample(f, c, pair, y);
        break;
    case SF_PIXEL_444P:
        for (int c = 1; c < 3; c++) s[c] = sample(f, c, x, y);
        break;
    default:
        break;
    }
    s[0] = sample(f, 0, x, y);
}

static void from_yuv(const sf_frame *f, const int s[3], double rgb[3]) {
    static const double kr[] = {0.299, 0.2126, 0.2627}, kb[] = {0.114, 0.0722, 0.0593};
    double Kr = kr[f->matrix], Kb = kb[f->matrix];
    double y = f->full_range ? s[0] / 255.0 : (s[0] - 16) / 219.0, chroma = f->full_range ? 255 : 224;
    rgb[0] = y + (2 - 2 * Kr) * (s[2] - 128) / chroma;
    rgb[2] = y + (2 - 2 * Kb) * (s[1] - 128) / chroma;
    rgb[1] = (y - Kr * rgb[0] - Kb * rgb[2]) / (1 - Kr - Kb);
    for (int c = 0; c < 3; c++) rgb[c] = rgb[c] < 0 ? 0 : rgb[c] > 1 ? 1 : rgb[c];
}

void test_ref_pixel(const sf_frame *f, int32_t x, int32_t y, double rgb[3]) {
    int s[3];
    if (f->format == SF_PIXEL_RGB24 || f->format == SF_PIXEL_BGR24) {
        for (int c = 0; c < 3; c++)
            rgb[c] = sample(f, 0, 3 * x + (f->format == SF_PIXEL_RGB24 ? c : 2 - c), y) / 255.0;
        return;
    }
    samples_at(f, x, y, s);
    from_yuv(f, s, rgb);
}
