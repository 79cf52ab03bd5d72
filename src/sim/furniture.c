/* furniture.c - what stands in the room of the simulated scene. */
#include <string.h>

#include "sheet.h"
#include "studio.h"

#define TOP   0.24 /* of the platform */
#define BLOCK 0.23 /* half the side of a toy block */

static sf_object *place(sf_studio *studio, sf_shape shape, sf_paint paint, sf_vec3 center, sf_vec3 half) {
    sf_object *o = &studio->objects[studio->count++];
    *o = (sf_object){.shape = shape, .paint = paint, .center = center, .half = half, .cos_yaw = 1};
    o->salt = (uint32_t)studio->count;
    o->bound = shape == SF_SHAPE_SPHERE ? half.x : vlength(half);
    return o;
}

static void ball(sf_studio *studio, sf_paint paint, sf_vec3 center, double radius, double mirror) {
    place(studio, SF_SHAPE_SPHERE, paint, center, vec3(radius, radius, radius))->mirror = mirror;
}

static void box(sf_studio *studio, sf_paint paint, sf_vec3 center, sf_vec3 half, double yaw) {
    sf_object *o = place(studio, SF_SHAPE_BOX, paint, center, half);
    o->cos_yaw = cos(yaw);
    o->sin_yaw = sin(yaw);
}

/* Where the two rooms differ: middles. */
typedef struct arrangement {
    sf_vec3 stripes, steel, blocks[4], crate, die;
} arrangement;

static void furnish(sf_studio *studio, const arrangement *a) {
    static const double yaws[4] = {0.35, 0.6, 0.1, -0.5};
    memset(studio, 0, sizeof *studio);
    studio->wall_near = 4.2; /* those at hand are behind the camera */
    box(studio, SF_PAINT_PARQUET, vec3(0, 0, TOP / 2), vec3(1.9, 1.9, TOP / 2), 0.25);

    ball(studio, SF_PAINT_GLAZE, vec3(0.12, 0.15, TOP + 0.52), 0.52, 0.06);
    ball(studio, SF_PAINT_GLOBE, vec3(-1.02, 0.72, TOP + 0.5), 0.5, 0);
    ball(studio, SF_PAINT_DOTS, vec3(1.2, 0.42, TOP + 0.34), 0.34, 0);
    ball(studio, SF_PAINT_STRIPES, a->stripes, 0.25, 0);
    ball(studio, SF_PAINT_STEEL, a->steel, 0.2, 0.6);

    for (int i = 0; i < 4; i++) box(studio, SF_PAINT_BLOCK, a->blocks[i], vec3(BLOCK, BLOCK, BLOCK), yaws[i]);
    box(studio, SF_PAINT_CRATE, a->crate, vec3(0.38, 0.38, 0.38), 0.45);
    box(studio, SF_PAINT_DIE, a->die, vec3(0.13, 0.13, 0.13), 0.95);
    box(studio, SF_PAINT_TARTAN, vec3(-0.1, 1.25, TOP + 0.32), vec3(0.32, 0.32, 0.32), -0.3);

    box(studio, SF_PAINT_BOOK, vec3(0.95, 1.2, TOP + 0.075), vec3(0.42, 0.3, 0.075), 0.35);
    box(studio, SF_PAINT_BOOK, vec3(0.97, 1.22, TOP + 0.215), vec3(0.38, 0.27, 0.065), 0.05);
    box(studio, SF_PAINT_BOOK, vec3(0.94, 1.2, TOP + 0.33), vec3(0.36, 0.25, 0.05), 0.6);
    ball(studio, SF_PAINT_STRIPES, vec3(0.95, 1.2, TOP + 0.38 + 0.15), 0.15, 0);
}

void sf_studio_init(sf_studio *studio) {
    static const arrangement usual = {
        .stripes = {-0.3, -1.3, TOP + 0.25},
        .steel = {-0.05, -0.72, TOP + 0.2},
        .blocks = {{0.62, -0.95, TOP + BLOCK},
                   {1.17, -0.68, TOP + BLOCK},
                   {0.88, -0.8, TOP + 3 * BLOCK},
                   {-1.45, -0.05, TOP + BLOCK}},
        .crate = {-0.95, -0.78, TOP + 0.38},
        .die = {-1.0, -0.72, TOP + 0.76 + 0.13},
    };
    furnish(studio, &usual);
}

void sf_studio_init_board(sf_studio *studio, sf_board_place *board) {
    /* Things make room for the board at the front. */
    static const arrangement aside = {
        .stripes = {-0.95, -1.4, TOP + 0.25},
        .steel = {0.75, -0.25, TOP + 0.2},
        .blocks = {{1.25, -0.78, TOP + BLOCK},
                   {1.38, -0.1, TOP + BLOCK},
                   {1.3, -0.45, TOP + 3 * BLOCK},
                   {-1.5, -0.02, TOP + BLOCK}},
        .crate = {-1.2, -0.75, TOP + 0.38},
        .die = {-1.25, -0.69, TOP + 0.76 + 0.13},
    };
    const double unit_m = 0.45, thick = 0.008, yaw = 1.68;
    double of_mm = SF_STUDIO_TAG_M / sf_sheet_a3.tag / unit_m; /* world units a mm of the sheet */
    furnish(studio, &aside);
    sf_vec3 middle = {0.15, -1.05, TOP + thick / 2};
    box(studio, SF_PAINT_BOARD, middle,
        vec3(sf_sheet_a3.width / 2 * of_mm, sf_sheet_a3.height / 2 * of_mm, thick / 2), yaw);
    double c = cos(yaw), s = sin(yaw);
    *board = (sf_board_place){
        .unit_m = unit_m, .origin = {middle.x, middle.y, TOP + thick}, .R_wb = {c, s, 0, s, -c, 0, 0, 0, -1}};
}

/* Things in a row along the outer walls, each on what stands on the floor. */
void sf_studio_init_corridor(sf_studio *studio) {
    enum { STANDS = 14 };
    static const sf_paint boxes[] = {SF_PAINT_CRATE, SF_PAINT_TARTAN, SF_PAINT_BLOCK, SF_PAINT_BOOK,
                                     SF_PAINT_DIE},
                          balls[] = {SF_PAINT_GLOBE, SF_PAINT_DOTS, SF_PAINT_STRIPES};
    const double turn = 6.283185307179586 / STANDS;
    memset(studio, 0, sizeof *studio);
    studio->wall_near = 2;
    box(studio, SF_PAINT_TARTAN, vec3(0, 0, 1.25), vec3(1.8, 1.8, 1.25), 0.06);
    for (int i = 0; i < STANDS; i++) {
        double angle = turn * (i + 0.2 * sin(5.0 * i)), radius = 4.45 + 0.15 * cos(3.0 * i);
        double half = 0.3 + 0.1 * cos(7.0 * i), size = 0.2 + 0.06 * sin(4.0 * i);
        sf_vec3 at = {radius * sin(angle), -radius * cos(angle), half};
        box(studio, boxes[i * 3 % 5], at, vec3(half, half, half), 0.7 * i);
        at.z = 2 * half + size;
        if (i % 2)
            ball(studio, balls[i / 2 % 3], at, size, 0);
        else
            box(studio, boxes[(i / 2 + 2) % 5], at, vec3(size, size, size), 1.1 * i);
    }
}
