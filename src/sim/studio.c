/* studio.c - the simulated scene: a furnished room, seen by an exact ray caster. */
#include "studio.h"

enum { SAMPLES = 4, ROOM = -1 }; /* SAMPLES x SAMPLES rays a pixel */

const sf_vec3 sf_studio_room_center = {0, 0, 2.3}, sf_studio_room_half = {5.2, 5.2, 2.3};
static const sf_paint room_paint[6] = {SF_PAINT_WALLPAPER, SF_PAINT_SHELVES, SF_PAINT_BRICKS,
                                       SF_PAINT_BRICKS,    SF_PAINT_CEILING, SF_PAINT_TILES};

/* A round lamp in the ceiling. */
typedef struct lamp {
    sf_vec3 center, power;
    double radius;
} lamp;

static const lamp lamps[2] = {{{-2.3, -2.6, 4.6}, {1.30, 1.16, 0.95}, 0.75},
                              {{3.0, 0.6, 4.6}, {0.42, 0.50, 0.62}, 1.0}};
const sf_vec3 sf_studio_lamp_glow = {5, 4.8, 4.4};
static const sf_vec3 sky_light = {0.30, 0.32, 0.36}, floor_light = {0.22, 0.18, 0.14};

typedef struct ray {
    sf_vec3 origin, direction; /* the direction is of length 1 */
} ray;

static sf_vec3 axis(int face) {
    double sign = face & 1 ? -1 : 1;
    return vec3(face / 2 == 0 ? sign : 0, face / 2 == 1 ? sign : 0, face / 2 == 2 ? sign : 0);
}

/* 1. What a ray meets */

/* Distances at which a ray enters and leaves each pair of a box's planes. */
typedef struct slab {
    double in, out;
} slab;

static slab slab_of(double origin, double direction, double half) {
    double inverse = 1 / direction, a = (-half - origin) * inverse, b = (half - origin) * inverse;
    return a < b ? (slab){a, b} : (slab){b, a};
}

/* A direction without exact zeros, so that no slab divides 0 by 0. */
static sf_vec3 off_axis(sf_vec3 d) {
    const double least = 1e-12;
    return vec3(d.x == 0 ? least : d.x, d.y == 0 ? least : d.y, d.z == 0 ? least : d.z);
}

static int meet_sphere(const sf_object *o, const ray *r, sf_hit *hit) {
    sf_vec3 to = vsub(o->center, r->origin);
    double along = vdot(to, r->direction), room = along * along - vdot(to, to) + o->half.x * o->half.x;
    if (room <= 0) return 0;
    double distance = along - sqrt(room);
    if (distance <= 1e-9 || distance >= hit->distance) return 0;
    hit->distance = distance;
    hit->face = 0;
    return 1;
}

static int meet_box(const sf_object *o, const ray *r, sf_hit *hit) {
    sf_vec3 p = sf_object_turned(o, vsub(r->origin, o->center)),
            d = off_axis(sf_object_turned(o, r->direction));
    slab x = slab_of(p.x, d.x, o->half.x), y = slab_of(p.y, d.y, o->half.y), z = slab_of(p.z, d.z, o->half.z);
    double in = greater(greater(x.in, y.in), z.in), out = lesser(lesser(x.out, y.out), z.out);
    if (in >= out || in <= 1e-9 || in >= hit->distance) return 0;
    hit->distance = in;
    hit->face = in == x.in ? d.x > 0 : in == y.in ? 2 + (d.y > 0) : 4 + (d.z > 0);
    return 1;
}

/* Where the ray leaves the room. */
static void meet_room(const ray *r, sf_hit *hit) {
    sf_vec3 p = vsub(r->origin, sf_studio_room_center), d = off_axis(r->direction);
    double x = slab_of(p.x, d.x, sf_studio_room_half.x).out, y = slab_of(p.y, d.y, sf_studio_room_half.y).out;
    double z = slab_of(p.z, d.z, sf_studio_room_half.z).out;
    hit->object = ROOM;
    hit->distance = lesser(lesser(x, y), z);
    hit->face = hit->distance == x ? d.x < 0 : hit->distance == y ? 2 + (d.y < 0) : 4 + (d.z < 0);
}

/* Whether the ray, `slack` wide per unit of distance, touches the object's bounding sphere. */
static int may_meet(const sf_object *o, const ray *r, double slack) {
    sf_vec3 to = vsub(o->center, r->origin);
    double along = vdot(to, r->direction), reach = o->bound + slack * fabs(along);
    return along > -o->bound && vdot(to, to) - along * along <= reach * reach;
}

/* Numbers of the objects that a ray has to be tested with. */
typedef struct candidates {
    int count;
    int objects[SF_STUDIO_MAX_OBJECTS];
} candidates;

static void gather(const sf_studio *studio, const ray *r, double slack, candidates *near) {
    near->count = 0;
    for (int i = 0; i < studio->count; i++)
        if (may_meet(&studio->objects[i], r, slack)) near->objects[near->count++] = i;
}

static void cast(const sf_studio *studio, const candidates *near, const ray *r, sf_hit *hit) {
    meet_room(r, hit);
    for (int i = 0; i < near->count; i++) {
        const sf_object *o = &studio->objects[near->objects[i]];
        if (o->shape == SF_SHAPE_SPHERE ? meet_sphere(o, r, hit) : meet_box(o, r, hit))
            hit->object = near->objects[i];
    }
    hit->point = vat(r->origin, hit->distance, r->direction);
    if (hit->object == ROOM) {
        hit->normal = vscale(axis(hit->face), -1);
        return;
    }
    const sf_object *o = &studio->objects[hit->object];
    if (o->shape == SF_SHAPE_SPHERE)
        hit->normal = vscale(vsub(hit->point, o->center), 1 / o->half.x);
    else
        hit->normal = sf_object_turned_back(o, axis(hit->face));
}

/* 2. What is painted there */

/* Right and up on a box's face as seen from outside. */
void sf_studio_face_position(int face, sf_vec3 p, sf_spot *spot) {
    switch (face) {
    case 0:
        spot->u = p.y, spot->v = p.z;
        break;
    case 1:
        spot->u = -p.y, spot->v = p.z;
        break;
    case 2:
        spot->u = -p.x, spot->v = p.z;
        break;
    case 3:
        spot->u = p.x, spot->v = p.z;
        break;
    case 4:
        spot->u = p.x, spot->v = p.y;
        break;
    default:
        spot->u = p.x, spot->v = -p.y;
        break;
    }
}

static sf_vec3 room_albedo(const sf_hit *hit) {
    sf_spot spot = {.local = vsub(hit->point, sf_studio_room_center), .face = hit->face};
    sf_studio_face_position(hit->face ^ 1, spot.local, &spot); /* walls are seen from inside */
    return sf_paint_albedo(room_paint[hit->face], &spot);
}

sf_vec3 sf_studio_albedo(const sf_studio *studio, const sf_hit *hit) {
    if (hit->object == ROOM) return room_albedo(hit);
    const sf_object *o = &studio->objects[hit->object];
    sf_spot spot = {
        .local = sf_object_turned(o, vsub(hit->point, o->center)), .face = hit->face, .salt = o->salt};
    if (o->shape == SF_SHAPE_BOX) {
        sf_studio_face_position(hit->face, spot.local, &spot);
        spot.hu = hit->face < 2 ? o->half.y : o->half.x;
        spot.hv = hit->face < 4 ? o->half.z : o->half.y;
    }
    return sf_paint_albedo(o->paint, &spot);
}

/* 3. How it is lit: all of it a smooth function of the place, so that every view sees the same */

static double outside_box(sf_vec3 p, sf_vec3 half) {
    sf_vec3 q = vec3(fabs(p.x) - half.x, fabs(p.y) - half.y, fabs(p.z) - half.z);
    double inside = lesser(greater(greater(q.x, q.y), q.z), 0);
    return inside + vlength(vec3(greater(q.x, 0), greater(q.y, 0), greater(q.z, 0)));
}

/* Signed distance to an object's surface, negative inside. */
static double clearance(const sf_object *o, sf_vec3 point) {
    sf_vec3 p = vsub(point, o->center);
    return o->shape == SF_SHAPE_SPHERE ? vlength(p) - o->half.x
                                       : outside_box(sf_object_turned(o, p), o->half);
}

/* The part of a lamp that an object leaves visible. The cone from the point to the lamp is `spread` t wide at
 * distance t; what counts is the least clearance / width along its axis. The clearance of a convex object is
 * a convex function there, and the ratio has one minimum, which a golden section search finds. */
static double unshadowed(const sf_object *o, const ray *to_lamp, double distance, double spread) {
    const double golden = 0.6180339887498949;
    if (!may_meet(o, to_lamp, spread)) return 1;
    double middle = vdot(vsub(o->center, to_lamp->origin), to_lamp->direction), ratio[2], at[2];
    double low = greater(middle - o->bound, 1e-3), high = lesser(middle + o->bound, distance);
    if (low >= high) return 1;
    for (int i = 0; i < 2; i++) {
        at[i] = low + (i ? golden : 1 - golden) * (high - low);
        ratio[i] = clearance(o, vat(to_lamp->origin, at[i], to_lamp->direction)) / (spread * at[i]);
    }
    for (int step = 0; step < 10; step++) {
        int i = ratio[0] < ratio[1];
        if (i) {
            high = at[1], at[1] = at[0], ratio[1] = ratio[0];
            at[0] = high - golden * (high - low);
        } else {
            low = at[0], at[0] = at[1], ratio[0] = ratio[1];
            at[1] = low + golden * (high - low);
        }
        double t = at[!i];
        ratio[!i] = clearance(o, vat(to_lamp->origin, t, to_lamp->direction)) / (spread * t);
    }
    double t = lesser(greater(0.5 + 0.5 * lesser(ratio[0], ratio[1]), 0), 1);
    return t * t * (3 - 2 * t);
}

static sf_vec3 lamp_light(const sf_studio *studio, const lamp *l, const sf_hit *hit) {
    sf_vec3 to = vsub(l->center, hit->point);
    double distance = vlength(to);
    ray r = {hit->point, vscale(to, 1 / distance)};
    double facing = vdot(r.direction, hit->normal), down = r.direction.z;
    if (facing <= 0 || down <= 0) return vec3(0, 0, 0);
    double strength = facing * down * 22 / (distance * distance);
    for (int i = 0; i < studio->count && strength > 0; i++)
        if (i != hit->object) strength *= unshadowed(&studio->objects[i], &r, distance, l->radius / distance);
    return vscale(l->power, strength);
}

/* How open the surroundings are, from the clearance at three heights above the surface. */
static double openness(const sf_studio *studio, const sf_hit *hit) {
    static const double heights[3] = {0.08, 0.22, 0.6}, weights[3] = {0.3, 0.3, 0.4};
    const double farthest = 1.2; /* twice the greatest height: nothing beyond it is near enough */
    double room[3], closed = 0;
    sf_vec3 above[3];
    for (int k = 0; k < 3; k++) {
        above[k] = vat(hit->point, heights[k], hit->normal);
        room[k] =
            lesser(heights[k], -outside_box(vsub(above[k], sf_studio_room_center), sf_studio_room_half));
    }
    for (int i = 0; i < studio->count; i++) {
        const sf_object *o = &studio->objects[i];
        sf_vec3 to = vsub(o->center, hit->point);
        if (vdot(to, to) > (o->bound + farthest) * (o->bound + farthest)) continue;
        for (int k = 0; k < 3; k++) room[k] = lesser(room[k], clearance(o, above[k]));
    }
    for (int k = 0; k < 3; k++) closed += weights[k] * (1 - greater(room[k], 0) / heights[k]);
    return 1 - 0.9 * closed;
}

sf_vec3 sf_studio_light(const sf_studio *studio, const sf_hit *hit) {
    sf_vec3 around = vmix(floor_light, sky_light, 0.5 + 0.5 * hit->normal.z);
    sf_vec3 light = vscale(around, openness(studio, hit));
    for (int i = 0; i < 2; i++) light = vadd(light, lamp_light(studio, &lamps[i], hit));
    return light;
}

int sf_studio_on_lamp(const sf_hit *hit) {
    if (hit->object != ROOM || hit->face != 4) return 0;
    for (int i = 0; i < 2; i++)
        if (vlength(vsub(hit->point, lamps[i].center)) < lamps[i].radius) return 1;
    return 0;
}

/* 4. What a pixel shows */

/* Light changes little within a pixel: it is worked out once for each surface that the pixel shows, while the
 * paint is looked up for every ray. */
typedef struct lit {
    int surface;
    sf_vec3 light;
} lit;

typedef struct pixel {
    const sf_studio *studio;
    int count;
    lit lights[2 * SAMPLES * SAMPLES];
} pixel;

static sf_vec3 cached_light(pixel *px, const sf_hit *hit, int reflected) {
    int surface = (hit->object + 1) * 16 + hit->face * 2 + reflected;
    for (int i = 0; i < px->count; i++)
        if (px->lights[i].surface == surface) return px->lights[i].light;
    lit *l = &px->lights[px->count++];
    *l = (lit){surface, sf_studio_light(px->studio, hit)};
    return l->light;
}

static sf_vec3 scattered(pixel *px, const sf_hit *hit, int reflected) {
    if (sf_studio_on_lamp(hit)) return sf_studio_lamp_glow;
    return vmul(sf_studio_albedo(px->studio, hit), cached_light(px, hit, reflected));
}

static sf_vec3 seen(pixel *px, const ray *r, const sf_hit *hit) {
    sf_vec3 matt = scattered(px, hit, 0);
    double mirror = hit->object == ROOM ? 0 : px->studio->objects[hit->object].mirror;
    if (mirror == 0) return matt;
    double facing = -vdot(r->direction, hit->normal), away = 1 - facing, away2 = away * away;
    double fresnel = mirror + (1 - mirror) * away2 * away2 * away;
    ray bounce = {hit->point, vat(r->direction, 2 * facing, hit->normal)};
    candidates near;
    sf_hit second;
    gather(px->studio, &bounce, 0, &near);
    cast(px->studio, &near, &bounce, &second);
    return vmix(matt, scattered(px, &second, 1), fresnel);
}

/* The ray from the camera's centre through a picture position. */
static ray look(const sf_camera *c, sf_vec3 eye, double x_px, double y_px) {
    double x = (x_px - c->cx) / c->fx, y = (y_px - c->cy) / c->fy;
    const double *R = c->R_cw;
    sf_vec3 d = vec3(R[0] * x + R[3] * y + R[6], R[1] * x + R[4] * y + R[7], R[2] * x + R[5] * y + R[8]);
    return (ray){eye, vunit(d)};
}

static sf_vec3 eye_of(const sf_camera *camera) {
    double center[3];
    sf_camera_center(camera, center);
    return vec3(center[0], center[1], center[2]);
}

void sf_studio_look(const sf_studio *studio, const sf_camera *camera, double x_px, double y_px, sf_hit *hit) {
    ray r = look(camera, eye_of(camera), x_px, y_px);
    candidates near;
    gather(studio, &r, 0, &near);
    cast(studio, &near, &r, hit);
}

sf_vec3 sf_studio_diffuse(const sf_studio *studio, const sf_hit *hit) {
    return vmul(sf_studio_albedo(studio, hit), sf_studio_light(studio, hit));
}

typedef struct drawing {
    const sf_studio *studio;
    const sf_camera *camera;
    sf_vec3 eye;
    float *rgb, *depth;
} drawing;

static double camera_z(const sf_camera *c, sf_vec3 p) {
    return c->R_cw[6] * p.x + c->R_cw[7] * p.y + c->R_cw[8] * p.z + c->t_cw[2];
}

static sf_vec3 average(const drawing *d, const candidates *near, int x, int y) {
    pixel px = {.studio = d->studio};
    sf_vec3 sum = {0, 0, 0};
    for (int i = 0; i < SAMPLES * SAMPLES; i++) {
        ray r = look(d->camera, d->eye, x + (i % SAMPLES + 0.5) / SAMPLES, y + (i / SAMPLES + 0.5) / SAMPLES);
        sf_hit hit;
        cast(d->studio, near, &r, &hit);
        sum = vadd(sum, seen(&px, &r, &hit));
    }
    return vscale(sum, 1.0 / (SAMPLES * SAMPLES));
}

static void draw_row(void *arg, size_t row, int thread) {
    const drawing *d = arg;
    int width = d->camera->width, y = (int)row;
    double slack = 0.75 / lesser(d->camera->fx, d->camera->fy); /* half a pixel's diagonal and a little */
    (void)thread;
    for (int x = 0; x < width; x++) {
        ray middle = look(d->camera, d->eye, x + 0.5, y + 0.5);
        size_t at = row * (size_t)width + (size_t)x;
        candidates near;
        gather(d->studio, &middle, slack, &near);
        if (d->rgb) {
            sf_vec3 color = average(d, &near, x, y);
            d->rgb[3 * at] = (float)color.x, d->rgb[3 * at + 1] = (float)color.y,
                       d->rgb[3 * at + 2] = (float)color.z;
        }
        if (d->depth) {
            sf_hit hit;
            cast(d->studio, &near, &middle, &hit);
            d->depth[at] = (float)camera_z(d->camera, hit.point);
        }
    }
}

void sf_studio_draw(const sf_studio *studio, struct sf_pool *pool, const sf_camera *camera, float *rgb,
                    float *depth) {
    drawing d = {studio, camera, eye_of(camera), rgb, depth};
    sf_pool_run(pool, (size_t)camera->height, draw_row, &d);
}
