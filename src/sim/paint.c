/* paint.c - what the surfaces of the simulated scene are painted with.
 *
 * Every paint is a plain function of the place. Edges are hard: the ray caster's supersampling smooths them.
 */
#include "paint.h"

#include <string.h>

#include "lettering.h"
#include "sheet.h"

/* A display colour 0xRRGGBB as linear light; squaring is close enough to the sRGB curve here. */
static sf_vec3 ink(uint32_t rgb) {
    double r = (rgb >> 16 & 255) / 255.0, g = (rgb >> 8 & 255) / 255.0, b = (rgb & 255) / 255.0;
    return vec3(r * r, g * g, b * b);
}

static uint32_t hash(int32_t x, int32_t y, uint32_t salt) {
    uint32_t h = (uint32_t)x * 0x9e3779b1u ^ (uint32_t)y * 0x85ebca77u ^ salt * 0xc2b2ae3du;
    h = (h ^ h >> 15) * 0x2c1b3c6du;
    h = (h ^ h >> 12) * 0x297a2d39u;
    return h ^ h >> 15;
}

/* Uniform in [0, 1), the same for the same cell. */
static double chance(int32_t x, int32_t y, uint32_t salt) { return (hash(x, y, salt) >> 8) * 0x1p-24; }

static int32_t cell(double x) { return whole_below(x); }
static double part(double x) { return x - whole_below(x); }
/* Distance to the nearest whole number. */
static double beside(double x) { return fabs(x - whole_below(x + 0.5)); }
static double ease(double t) { return t * t * (3 - 2 * t); }

/* Smooth noise in [0, 1] with features of about one unit. */
static double noise(double x, double y, uint32_t salt) {
    int32_t i = cell(x), j = cell(y);
    double s = ease(x - i), t = ease(y - j);
    double a = chance(i, j, salt), b = chance(i + 1, j, salt);
    double c = chance(i, j + 1, salt), d = chance(i + 1, j + 1, salt);
    return a + s * (b - a) + t * (c - a + s * (a - b - c + d));
}

static double noise3(sf_vec3 p, uint32_t salt) {
    int32_t k = cell(p.z);
    uint32_t layer = salt + 101 * (uint32_t)k;
    double a = noise(p.x, p.y, layer), b = noise(p.x, p.y, layer + 101);
    return a + ease(p.z - k) * (b - a);
}

/* Boards along u, `width` high, with grain along them and dark joints. */
static sf_vec3 boards(double u, double v, double width, sf_vec3 light, sf_vec3 dark, uint32_t salt) {
    int32_t row = cell(v / width);
    double along = u + 3 * chance(row, 7, salt);
    int32_t board = cell(along / (8 * width));
    double tone = chance(row, board, salt + 1);
    double grain = noise(along * 4, v * 30, salt + 2 + (uint32_t)board);
    double joint = lesser(beside(v / width) * width, beside(along / (8 * width)) * 8 * width);
    sf_vec3 color = vmix(light, dark, 0.45 * tone + 0.25 * grain);
    return joint < 0.012 ? vscale(color, 0.45) : color;
}

static sf_vec3 tiles(const sf_spot *s) {
    const double size = 0.8;
    double x = s->u / size, y = s->v / size;
    double corner = (beside(x) + beside(y)) * size;
    if (corner < 0.16) return corner < 0.14 ? ink(0xa8503c) : ink(0x5c564e);
    if (lesser(beside(x), beside(y)) * size < 0.012) return ink(0x6a645a);
    int dark = (cell(x) + cell(y)) & 1;
    uint32_t own = hash(cell(x), cell(y), 5);
    double vein = noise(s->u * 4 + 1.5 * noise(s->u * 3, s->v * 3, own), s->v * 4, own);
    vein = fabs(2 * vein - 1);
    double cloud = noise(s->u * 9, s->v * 9, own + 1);
    sf_vec3 base = dark ? ink(0x50707a) : ink(0xd8ccb4), line = dark ? ink(0x7d9aa0) : ink(0xbca98d);
    base = vscale(base, 0.9 + 0.2 * cloud);
    return vein < 0.12 ? vmix(line, base, vein / 0.12) : base;
}

typedef struct poster {
    double u, v, hu, hv;
} poster;

static int on_poster(const poster *p, double u, double v) {
    return fabs(u - p->u) < p->hu && fabs(v - p->v) < p->hv;
}

static int in_frame(const poster *p, double u, double v, double width) {
    return fabs(u - p->u) > p->hu - width || fabs(v - p->v) > p->hv - width;
}

/* Hills in front of a striped evening sun; x -1..1, y -1..1. */
static sf_vec3 landscape(double x, double y) {
    double far_hill = -0.15 + 0.3 * noise(x * 2.5, 0.5, 31) + 0.06 * noise(x * 11, 0.5, 32);
    double near_hill = -0.5 + 0.35 * noise(x * 1.7, 0.5, 33) + 0.05 * noise(x * 16, 0.5, 34);
    if (y < near_hill) return noise(x * 14, y * 30, 35) > 0.55 ? ink(0x0f4c4a) : ink(0x17706a);
    if (y < far_hill) return noise(x * 9, y * 18, 36) > 0.5 ? ink(0x2f7f9a) : ink(0x3a6f94);
    double sun = (x - 0.2) * (x - 0.2) + (y - 0.35) * (y - 0.35);
    if (sun < 0.2) return part(y * 9) < 0.2 ? ink(0xf0a050) : ink(0xffe08a);
    return vmix(ink(0xf28a4b), ink(0x7a3a68), cell(greater(0, 3.5 * y + 1)) / 6.0);
}

static sf_vec3 splat_poster(const poster *p, double u, double v) {
    double x = (u - p->u) / p->hu, y = (v - p->v) / p->hu;
    if (in_frame(p, u, v, 0.05)) return ink(0x1d1a18);
    if (in_frame(p, u, v, 0.13)) return ink(0xf4efe2);
    if (y > 0.62) {
        sf_line title = {"SPLATFIT", -0.82, 0.74, 0.0355, 0.75};
        return sf_lettering(&title, x, y) ? ink(0x1b2440) : ink(0xf4efe2);
    }
    return landscape(x, y + 0.25);
}

/* Overlapping discs: the field's own picture of itself. */
static sf_vec3 disc_poster(const poster *p, double u, double v) {
    static const struct {
        double x, y, r;
        uint32_t rgb;
    } discs[] = {{-0.25, 0.5, 0.45, 0xe4572e}, {0.3, 0.25, 0.4, 0x2e86ab},    {-0.2, -0.1, 0.35, 0xf6ae2d},
                 {0.35, -0.4, 0.3, 0x3f7d4e},  {-0.4, -0.65, 0.22, 0x5b3a7d}, {0.45, 0.8, 0.17, 0x1b2440}};
    double x = (u - p->u) / p->hu, y = (v - p->v) / p->hu;
    if (in_frame(p, u, v, 0.045)) return ink(0x8a5a2b);
    sf_vec3 color = ink(0xefe6d2);
    for (int i = 0; i < 6; i++) {
        double dx = x - discs[i].x, dy = y - discs[i].y, r = sqrt(dx * dx + dy * dy) / discs[i].r;
        if (r < 1) color = vmix(color, ink(discs[i].rgb), part(r * 3.5) < 0.6 ? 0.9 : 0.35);
    }
    sf_line title = {"GAUSSIANS", -0.82, -1.2, 0.0312, 0.75};
    return sf_lettering(&title, x, y) ? ink(0x1b2440) : color;
}

static sf_vec3 bricks(const sf_spot *s) {
    static const poster splat = {-1.25, -1.0, 0.95, 1.1}, discs = {1.45, -1.0, 0.78, 1.0};
    if (on_poster(&splat, s->u, s->v)) return splat_poster(&splat, s->u, s->v);
    if (on_poster(&discs, s->u, s->v)) return disc_poster(&discs, s->u, s->v);
    const double width = 0.72, height = 0.26, gap = 0.036;
    int32_t row = cell(s->v / height);
    double along = s->u / width + 0.5 * (row & 1);
    double grit = noise(s->u * 9, s->v * 9, 11);
    if (beside(along) * width < gap / 2 || beside(s->v / height) * height < gap / 2)
        return vscale(ink(0xa89884), 0.8 + 0.3 * grit);
    double tone = chance(cell(along), row, 12);
    sf_vec3 color = vmix(ink(0x8e3b2a), ink(0xc97a55), tone);
    if (chance(cell(along), row, 13) > 0.92) color = ink(0x6b3f36);
    return vscale(color, 0.8 + 0.35 * grit);
}

/* The back of a book; x and y from 0 to 1. */
static sf_vec3 spine(double x, double y, int32_t number, int32_t shelf) {
    static const uint32_t covers[] = {0x9c2f2f, 0x2f5d8a, 0x2f6b4f, 0xd9b44a, 0x4a3b5c, 0xe8dfcb,
                                      0xc8652e, 0x1f2f46, 0x7f8f5a, 0xb85c7a, 0x3c8f8f, 0x6b4a32};
    uint32_t own = hash(number, shelf, 21);
    sf_vec3 cover = ink(covers[own % 12]), band = ink(covers[(own >> 8) % 12]);
    if ((own >> 16 & 3) == 0 && (fabs(y - 0.85) < 0.03 || fabs(y - 0.15) < 0.03)) return ink(0xe2c06a);
    if (own >> 17 & 1 && fabs(y - 0.72) < 0.07) return band;
    if ((own >> 18 & 3) == 0 && fabs(x - 0.5) < 0.2 && y > 0.3 && y < 0.6)
        return part(y * 13.4) < 0.5 ? ink(0xe8dcb8) : cover;
    return vscale(cover, 1.05 - 1.2 * (x - 0.5) * (x - 0.5));
}

/* Books stand in pairs that share two slots, so that their widths vary. */
static sf_vec3 shelves(const sf_spot *s) {
    const double height = 0.84, bay = 2.1, board = 0.06, upright = 0.08, slot = 0.17;
    int32_t shelf = cell(s->v / height), column = cell(s->u / bay);
    double x = part(s->u / bay) * bay - upright, y = part(s->v / height) * height - board;
    if (x < 0 || y < 0) return boards(s->v, s->u, 0.3, ink(0x8a6440), ink(0x5f4028), 24);
    int32_t pair = cell(x / (2 * slot));
    double split = 0.7 + 0.6 * chance(pair, shelf, 25 + (uint32_t)column);
    double at = x / slot - 2 * pair;
    int second = at > split;
    int32_t number = 2 * pair + second + 40 * column;
    double tall = 0.5 + 0.2 * chance(number, shelf, 27);
    double across = second ? (at - split) / (2 - split) : at / split;
    int gap = chance(number, shelf, 28) < 0.07;
    if (gap || y > tall || across < 0.06) return ink(0x3a2a1e);
    return spine(across, y / tall, number, shelf);
}

static sf_vec3 eye_chart(const poster *p, double u, double v) {
    static const sf_line rows[] = {{"E", -0.15, 0.66, 0.075, 0.75},
                                   {"F P", -0.38, 0.26, 0.048, 0.75},
                                   {"T O Z", -0.51, -0.08, 0.0365, 0.75},
                                   {"L P E D", -0.6, -0.42, 0.03, 0.75},
                                   {"P E C F D", -0.66, -0.72, 0.0255, 0.75}};
    double x = (u - p->u) / p->hu, y = (v - p->v) / p->hu;
    if (in_frame(p, u, v, 0.04)) return ink(0x20242a);
    for (int i = 0; i < 5; i++)
        if (sf_lettering(&rows[i], x, y)) return ink(0x15151a);
    if (fabs(y + 0.92) < 0.025) return ink(0x2f8f4a);
    if (fabs(y - 0.19) < 0.02) return ink(0xc0392b);
    return ink(0xf3f1ea);
}

static sf_vec3 wallpaper(const sf_spot *s) {
    static const poster chart = {0.2, -0.6, 0.95, 1.1};
    if (on_poster(&chart, s->u, s->v)) return eye_chart(&chart, s->u, s->v);
    if (s->v < -1.6) return boards(s->v, s->u, 0.34, ink(0x7d5a3c), ink(0x4f3623), 41);
    if (s->v < -1.5) return ink(0xe8dcc0);
    double x = s->u / 0.8, y = s->v / 1.04, a = part(x + y), b = part(x - y);
    double motif = lesser(fabs(a - 0.5), fabs(b - 0.5));
    sf_vec3 ground = (cell(x + y) + cell(x - y)) & 1 ? ink(0x44807f) : ink(0x528f8c);
    if (lesser(beside(x + y), beside(x - y)) < 0.06) return ink(0xc4b070);
    if (fabs(a - 0.5) < 0.2 && fabs(b - 0.5) < 0.2) return motif < 0.06 ? ink(0xe4dcc0) : ink(0xb86a4c);
    return ground;
}

/* Rings of latitude, and three planes through the axis for six meridians. */
static int graticule(sf_vec3 p) {
    static const double c[3] = {1, 0.5, -0.5}, s[3] = {0, 0.8660254037844386, 0.8660254037844386};
    double around = sqrt(p.x * p.x + p.y * p.y);
    for (int i = 0; i < 3; i++)
        if (fabs(p.x * c[i] + p.y * s[i]) < 0.018 && around > 0.12) return 1;
    return beside(p.z * 2 + 0.5) < 0.03;
}

static sf_vec3 globe(const sf_spot *s) {
    sf_vec3 p = vunit(s->local), q = vscale(p, 2.1);
    double land = noise3(q, 51) + 0.45 * noise3(vscale(q, 2.7), 52) + 0.15 * noise3(vscale(q, 6), 53);
    double fine = noise3(vscale(p, 9), 54);
    if (graticule(p)) return ink(0xd4dcd4);
    if (fabs(p.z) > 0.86 + 0.08 * fine) return ink(0xf4f6f8);
    if (land < 0.8) return vmix(ink(0x1f5a8c), ink(0x3f8cba), 0.55 * fine + greater(0, land - 0.5));
    if (land < 0.83) return ink(0xf0dfa8);
    return vmix(ink(0x3f7f3a), ink(0xc79a56), ease(lesser(1, 1.5 * fabs(fine - 0.3) + greater(0, land - 1))));
}

/* Small balls on a cubic lattice, where they meet the sphere. */
static sf_vec3 dots(const sf_spot *s) {
    sf_vec3 p = vunit(s->local);
    double x = p.x / 0.44, y = p.y / 0.44, z = p.z / 0.44;
    double dx = x - whole_below(x + 0.5), dy = y - whole_below(y + 0.5), dz = z - whole_below(z + 0.5);
    double r = dx * dx + dy * dy + dz * dz;
    uint32_t own = hash(cell(x + 0.5), cell(y + 0.5), 61 + (uint32_t)cell(z + 0.5));
    static const uint32_t inks[] = {0xe4572e, 0x2e86ab, 0xf6ae2d, 0x3f7d4e, 0x8f3a7d};
    if (r < 0.13) return ink(inks[own % 5]);
    return r < 0.17 ? ink(0x1d1a18) : ink(0xf5f1e6);
}

static sf_vec3 stripes(const sf_spot *s) {
    sf_vec3 p = vunit(s->local);
    double slope = 0.8 * p.z + 0.5 * p.x + 0.33 * p.y;
    int band = cell(slope * 4.5 + 20) % 4;
    double edge = beside(slope * 4.5);
    if (edge < 0.07) return ink(0x1c2733);
    static const uint32_t inks[4] = {0xf5f1e6, 0xd1495b, 0xf5f1e6, 0x30638e};
    return ink(inks[band]);
}

static sf_vec3 tartan(const sf_spot *s) {
    if (fabs(s->u) < 0.055 || (s->face < 4 ? 0 : fabs(s->v) < 0.055))
        return part((s->u + s->v) * 16) < 0.3 ? ink(0xd8b04e) : ink(0xeac672);
    double x = part(s->u / 0.32 + 0.25), y = part(s->v / 0.32 + 0.25);
    int weave = part((s->u + s->v) * 18) < 0.5;
    double at = weave ? x : y;
    if (fabs(at - 0.6) < 0.04) return ink(0xe8dcc0);
    if (at < 0.3) return ink(0x123c2c);
    return at < 0.42 ? ink(0x101a30) : ink(0xa31f2b);
}

static sf_vec3 die(const sf_spot *s) {
    /* Pips of the nine places, row by row from the top left. */
    static const char *const pips[6] = {"....o....", "oo.o..o.o", "o...o...o",
                                        "o.o...o.o", "o.o.o.o.o", "o.oo.oo.o"};
    static const int number[6] = {0, 5, 2, 3, 4, 1};
    double x = s->u / s->hu * 1.5 + 1.5, y = 1.5 - s->v / s->hv * 1.5;
    int column = x < 1 ? 0 : x < 2 ? 1 : 2, row = y < 1 ? 0 : y < 2 ? 1 : 2;
    double dx = x - column - 0.5, dy = y - row - 0.5;
    int pip = pips[number[s->face]][3 * row + column] == 'o' && dx * dx + dy * dy < 0.11;
    return pip ? ink(0x1a1a20) : ink(0xf6f2e8);
}

static sf_vec3 block(const sf_spot *s) {
    static const char *const words[] = {"SPLATF", "GAUSIN", "FITCAM", "RAYBOX"};
    static const uint32_t inks[] = {0xc8322b, 0x2563a8, 0x2c8a4b, 0xd98a1f, 0x7a3f8f};
    uint32_t own = s->salt + (uint32_t)s->face;
    double edge = greater(fabs(s->u) / s->hu, fabs(s->v) / s->hv);
    sf_vec3 wood = vmix(ink(0xf0d6a4), ink(0xd2a869), noise(s->u * 12, s->v * 60, own));
    if (edge > 0.94) return vscale(wood, 0.65);
    if (edge > 0.74) return edge > 0.78 && edge < 0.9 ? ink(inks[own % 5]) : wood;
    const char letter[2] = {words[s->salt % 4][s->face], 0};
    sf_line line = {letter, -0.32, -0.48, 0.16, 0.85};
    return sf_lettering(&line, s->u / s->hu, s->v / s->hv) ? ink(inks[(own + 2) % 5]) : wood;
}

static sf_vec3 crate(const sf_spot *s) {
    double edge_u = s->hu - fabs(s->u), edge_v = s->hv - fabs(s->v);
    sf_vec3 light = ink(0xd9a863), dark = ink(0x8a5a2c);
    double nail_u = edge_u - 0.06, nail_v = edge_v - 0.06;
    if (nail_u * nail_u + nail_v * nail_v < 0.0005) return ink(0x2c2a2a);
    if (edge_v < 0.12)
        return edge_v > 0.108 ? ink(0x3a2413) : boards(s->u, s->v + 0.003, 0.3, light, dark, 71);
    if (edge_u < 0.12)
        return edge_u > 0.108 ? ink(0x3a2413) : boards(s->v, s->u + 0.003, 0.3, light, dark, 72);
    double brace = fabs(s->u / s->hu + s->v / s->hv) * 0.707 * s->hu;
    if (brace < 0.075)
        return brace > 0.063 ? ink(0x3a2413) : boards(s->u - s->v, s->u + s->v, 0.4, light, dark, 73);
    return vscale(boards(s->u, s->v, 0.13, light, dark, 74), 0.72);
}

static sf_vec3 book(const sf_spot *s) {
    static const uint32_t covers[] = {0x1f4e79, 0xa23b2e, 0x2f6b4f};
    static const char *const titles[] = {"GAUSS", "RAYS", "LIGHT"};
    sf_vec3 cover = ink(covers[s->salt % 3]);
    if (s->face < 4) {
        if (fabs(s->v) > s->hv - 0.018 || s->face == 3) {
            sf_line title = {titles[s->salt % 3], -0.22, -0.035, 0.0125, 0.8};
            return s->face == 3 && sf_lettering(&title, s->u, s->v) ? ink(0xf0d890) : cover;
        }
        return part(s->v * 45) < 0.4 ? ink(0xcbbf9f) : ink(0xf3ecd8);
    }
    double edge = lesser(s->hu - fabs(s->u), s->hv - fabs(s->v));
    if (edge > 0.035 && edge < 0.05) return ink(0xe2c06a);
    const double unit = 0.0205, middle = (6 * (double)strlen(titles[s->salt % 3]) - 2) / 2;
    sf_line title = {titles[s->salt % 3], -middle * unit, 0.02, unit, 0.8};
    if (sf_lettering(&title, s->u, s->v)) return ink(0xf0d890);
    return s->v < -0.06 && s->v > -0.16 && fabs(s->u) < 0.3 && part(s->v * 26) < 0.45 ? ink(0xf0d890) : cover;
}

static sf_vec3 parquet(const sf_spot *s) {
    const double size = 0.56;
    int32_t i = cell(s->u / size), j = cell(s->v / size);
    uint32_t own = 80 + (hash(i, j, 81) & 0xff);
    int turned = (i + j) & 1;
    double u = turned ? s->v : s->u, v = turned ? s->u : s->v;
    return boards(u, v, size / 4, ink(0xdcae74), ink(0x9a6433), own);
}

/* Paper and toner. */
static sf_vec3 board(const sf_spot *s) {
    double mm = sf_sheet_a3.width / (2 * s->hu);
    int black = s->face == 4 && sf_sheet_black(&sf_sheet_a3, s->u * mm, -s->v * mm);
    return black ? ink(0x1c1c1e) : ink(0xeeeeea);
}

sf_vec3 sf_paint_albedo(sf_paint paint, const sf_spot *spot) {
    switch (paint) {
    case SF_PAINT_TILES:
        return tiles(spot);
    case SF_PAINT_BRICKS:
        return bricks(spot);
    case SF_PAINT_SHELVES:
        return shelves(spot);
    case SF_PAINT_WALLPAPER:
        return wallpaper(spot);
    case SF_PAINT_CEILING:
        return ink(0xeee8dc);
    case SF_PAINT_PARQUET:
        return parquet(spot);
    case SF_PAINT_CRATE:
        return crate(spot);
    case SF_PAINT_GLAZE:
        return ink(0x127f86);
    case SF_PAINT_STEEL:
        return ink(0x202226);
    case SF_PAINT_GLOBE:
        return globe(spot);
    case SF_PAINT_DOTS:
        return dots(spot);
    case SF_PAINT_STRIPES:
        return stripes(spot);
    case SF_PAINT_TARTAN:
        return tartan(spot);
    case SF_PAINT_DIE:
        return die(spot);
    case SF_PAINT_BLOCK:
        return block(spot);
    case SF_PAINT_BOOK:
        return book(spot);
    case SF_PAINT_BOARD:
        return board(spot);
    }
    return vec3(0, 0, 0);
}
