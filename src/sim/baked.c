/* baked.c - the simulated scene drawn fast: light and paint are worked out once and kept as textures. */
#include "baked.h"

#include <string.h>

#include "texture.h"

enum { ROOM = -1, FACES = 6, SURFACES = (SF_STUDIO_MAX_OBJECTS + 1) * FACES, TILE = 16 };

struct sf_baked {
    sf_context *ctx;
    const sf_studio *studio;
    sf_texture textures[SURFACES]; /* by object + 1 and face; a ball has those of a cube around it */
    uint16_t *surfaces;            /* of the picture's pixels */
};

static int surface_of(int object, int face) { return (object + 1) * FACES + face; }

/* 1. Places on a surface */

static double *part(sf_vec3 *p, int axis) { return axis == 0 ? &p->x : axis == 1 ? &p->y : &p->z; }
static double get(sf_vec3 p, int axis) { return axis == 0 ? p.x : axis == 1 ? p.y : p.z; }

/* The place on the face of a box; sf_studio_face_position goes back. */
static sf_vec3 on_face(int face, sf_vec3 half, double u, double v) {
    switch (face) {
    case 0:
        return vec3(half.x, u, v);
    case 1:
        return vec3(-half.x, -u, v);
    case 2:
        return vec3(-u, half.y, v);
    case 3:
        return vec3(u, -half.y, v);
    case 4:
        return vec3(u, v, half.z);
    default:
        return vec3(u, -v, -half.z);
    }
}

/* The outward axis of a face. */
static sf_vec3 axis_of(int face) {
    sf_vec3 n = {0, 0, 0};
    *part(&n, face / 2) = face & 1 ? -1 : 1;
    return n;
}

/* u, v on the face of a cube around a ball: the other two axes, divided by this one. */
static sf_vec3 on_ball(int face, double u, double v) {
    sf_vec3 d = axis_of(face);
    *part(&d, (face / 2 + 1) % 3) = u;
    *part(&d, (face / 2 + 2) % 3) = v;
    return vunit(d);
}

static int face_of_ball(sf_vec3 n, double *u, double *v) {
    double x = fabs(n.x), y = fabs(n.y), z = fabs(n.z);
    int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    double most = fabs(get(n, axis));
    *u = get(n, (axis + 1) % 3) / most;
    *v = get(n, (axis + 2) % 3) / most;
    return 2 * axis + (get(n, axis) < 0);
}

/* What a ray that meets the surface there would report. */
static void hit_at(const sf_studio *studio, int object, int face, double u, double v, sf_hit *hit) {
    *hit = (sf_hit){.object = object, .face = face};
    if (object == ROOM) {
        sf_vec3 p = on_face(face ^ 1, sf_studio_room_half, u, v); /* the wall across: seen from inside */
        *part(&p, face / 2) *= -1;
        hit->point = vadd(sf_studio_room_center, p);
        hit->normal = vscale(axis_of(face), -1);
        return;
    }
    const sf_object *o = &studio->objects[object];
    if (o->shape == SF_SHAPE_SPHERE) {
        hit->face = 0;
        hit->normal = on_ball(face, u, v);
        hit->point = vat(o->center, o->half.x, hit->normal);
        return;
    }
    hit->point = vadd(o->center, sf_object_turned_back(o, on_face(face, o->half, u, v)));
    hit->normal = sf_object_turned_back(o, axis_of(face));
}

/* 2. Baking */

typedef struct baking {
    const sf_studio *studio;
    sf_texture *texture;
    int object, face, columns, rows; /* of `light`, which has one more each way */
    int samples;                     /* a side of a texel */
    sf_vec3 *light;
} baking;

static void bake_light(void *arg, size_t row, int thread) {
    const baking *b = arg;
    const sf_texture *t = b->texture;
    (void)thread;
    for (int i = 0; i <= b->columns; i++) {
        sf_hit hit;
        /* A hair inside, where the neighbouring face is not met. */
        double x = lesser(greater((double)i / b->columns, 1e-4), 1 - 1e-4);
        double y = lesser(greater((double)row / b->rows, 1e-4), 1 - 1e-4);
        hit_at(b->studio, b->object, b->face, t->left + x * t->width, t->bottom + y * t->height, &hit);
        b->light[row * (size_t)(b->columns + 1) + (size_t)i] = sf_studio_light(b->studio, &hit);
    }
}

static sf_vec3 light_between(const baking *b, double x, double y) {
    double u = x * b->columns, v = y * b->rows;
    int i = (int)u < b->columns ? (int)u : b->columns - 1, j = (int)v < b->rows ? (int)v : b->rows - 1;
    const sf_vec3 *at = b->light + (size_t)j * (size_t)(b->columns + 1) + (size_t)i;
    return vmix(vmix(at[0], at[1], u - i), vmix(at[b->columns + 1], at[b->columns + 2], u - i), v - j);
}

static void bake_row(void *arg, size_t row, int thread) {
    const baking *b = arg;
    sf_texture *t = b->texture;
    int width = t->level[0].width, height = t->level[0].height, n = b->samples;
    (void)thread;
    for (int x = 0; x < width; x++) {
        sf_vec3 paint = {0, 0, 0}, glow = {0, 0, 0};
        for (int k = 0; k < n * n; k++) {
            double u = (x + (k % n + 0.5) / n) / width, v = ((double)row + (k / n + 0.5) / n) / height;
            sf_hit hit;
            hit_at(b->studio, b->object, b->face, t->left + u * t->width, t->bottom + v * t->height, &hit);
            if (sf_studio_on_lamp(&hit))
                glow = vat(glow, 1.0 / (n * n), sf_studio_lamp_glow);
            else
                paint = vat(paint, 1.0 / (n * n), sf_studio_albedo(b->studio, &hit));
        }
        sf_vec3 light = light_between(b, (x + 0.5) / width, ((double)row + 0.5) / height);
        sf_texture_put(t, x, (int)row, vadd(glow, vmul(paint, light)));
    }
}

/* World units between two places where light is worked out. */
static double light_step(const baking *b) {
    if (b->object == ROOM) return b->face == 5 ? 0.08 : 0.2;
    return 0.035;
}

static sf_status bake(sf_baked *baked, int object, int face, double texel) {
    sf_texture *t = &baked->textures[surface_of(object, face)];
    const sf_object *o = object == ROOM ? NULL : &baked->studio->objects[object];
    baking b = {.studio = baked->studio, .texture = t, .object = object, .face = face, .samples = 2};
    sf_vec3 half = o ? o->half : sf_studio_room_half;
    double hu = face < 2 ? half.y : half.x, hv = face < 4 ? half.z : half.y; /* world units */
    int is_ball = o && o->shape == SF_SHAPE_SPHERE, is_board = o && o->paint == SF_PAINT_BOARD;
    if (is_board) texel /= 2, b.samples = 3;
    *t = (sf_texture){
        .per_square = 1 / (texel * texel), .left = -hu, .bottom = -hv, .width = 2 * hu, .height = 2 * hv};
    if (is_ball) t->left = t->bottom = -1, t->width = t->height = 2;
    double step = light_step(&b);
    b.columns = (int)ceil(2 * hu / step), b.rows = (int)ceil(2 * hv / step);
    sf_status status = sf_texture_create(baked->ctx, (int)ceil(2 * hu / texel), (int)ceil(2 * hv / texel), t);
    if (status == SF_OK &&
        !(b.light = sf_alloc(baked->ctx, (size_t)(b.columns + 1) * (size_t)(b.rows + 1), sizeof *b.light)))
        status = SF_ERR_MEMORY;
    if (status != SF_OK) return status;
    sf_pool_run(baked->ctx->pool, (size_t)b.rows + 1, bake_light, &b);
    sf_pool_run(baked->ctx->pool, (size_t)t->level[0].height, bake_row, &b);
    sf_texture_reduce(t);
    sf_free(baked->ctx, b.light);
    return SF_OK;
}

/* The least distance of the cameras to an object. */
static double nearest(const sf_studio *studio, int object, const sf_vec3 *eyes, size_t count) {
    const double least = 0.4;
    if (object == ROOM) return studio->wall_near;
    double near = 100;
    for (size_t i = 0; i < count; i++) {
        const sf_object *o = &studio->objects[object];
        sf_vec3 p = sf_object_turned(o, vsub(eyes[i], o->center));
        sf_vec3 q = o->shape == SF_SHAPE_SPHERE
                        ? vec3(vlength(p) - o->half.x, 0, 0)
                        : vec3(fabs(p.x) - o->half.x, fabs(p.y) - o->half.y, fabs(p.z) - o->half.z);
        near = lesser(near, vlength(vec3(greater(q.x, 0), greater(q.y, 0), greater(q.z, 0))));
    }
    return greater(near, least);
}

sf_status sf_baked_create(sf_context *ctx, const sf_studio *studio, const sf_vec3 *eyes, size_t count,
                          double focal, size_t pixels, sf_baked **baked) {
    sf_status status = SF_OK;
    sf_baked *b = *baked = sf_calloc(ctx, 1, sizeof *b);
    if (!b) return SF_ERR_MEMORY;
    b->ctx = ctx;
    b->studio = studio;
    if (!(b->surfaces = sf_alloc(ctx, pixels, sizeof *b->surfaces))) status = SF_ERR_MEMORY;
    for (int object = ROOM; object < studio->count && status == SF_OK; object++) {
        double texel = nearest(studio, object, eyes, count) / focal;
        for (int face = 0; face < FACES && status == SF_OK; face++) {
            /* The ceiling is plain, and boxes lie on their lower faces. */
            int coarse =
                object == ROOM ? face == 4 : face == 5 && studio->objects[object].shape == SF_SHAPE_BOX;
            status = bake(b, object, face, coarse ? 4 * texel : texel);
        }
    }
    if (status != SF_OK) sf_baked_destroy(baked);
    return status;
}

void sf_baked_destroy(sf_baked **baked) {
    sf_baked *b = *baked;
    if (!b) return;
    for (int i = 0; i < SURFACES; i++) sf_free(b->ctx, b->textures[i].level[0].texels);
    sf_free(b->ctx, b->surfaces);
    sf_free(b->ctx, b);
    *baked = NULL;
}

/* 3. What a ray meets */

/* A place that rays start from, also in the axes of each object. */
typedef struct eye {
    sf_vec3 at, in_room, in[SF_STUDIO_MAX_OBJECTS];
} eye;

static void eye_at(const sf_studio *studio, sf_vec3 at, eye *e) {
    e->at = at;
    e->in_room = vsub(at, sf_studio_room_center);
    for (int i = 0; i < studio->count; i++)
        e->in[i] = sf_object_turned(&studio->objects[i], vsub(at, studio->objects[i].center));
}

/* The surface that is met first at `direction` times t, and both in the object's axes. */
typedef struct met {
    int object, face;
    double t;
    sf_vec3 local, direction;
} met;

static void leave_room(const eye *e, sf_vec3 d, met *m) {
    sf_vec3 p = e->in_room, h = sf_studio_room_half;
    double x = ((d.x > 0 ? h.x : -h.x) - p.x) / d.x, y = ((d.y > 0 ? h.y : -h.y) - p.y) / d.y;
    double z = ((d.z > 0 ? h.z : -h.z) - p.z) / d.z;
    if (x < y && x < z)
        m->t = x, m->face = d.x < 0;
    else if (y < z)
        m->t = y, m->face = 2 + (d.y < 0);
    else
        m->t = z, m->face = 4 + (d.z < 0);
}

static void meet_ball(const sf_object *o, int object, sf_vec3 p, sf_vec3 d, met *m) {
    double a = vdot(d, d), b = -vdot(p, d), room = b * b - a * (vdot(p, p) - o->half.x * o->half.x);
    if (room <= 0) return;
    double t = (b - sqrt(room)) / a;
    if (t <= 1e-9 || t >= m->t) return;
    m->object = object, m->face = 0, m->t = t;
}

static void meet_box(const sf_object *o, int object, sf_vec3 p, sf_vec3 d, met *m) {
    double ix = 1 / d.x, iy = 1 / d.y, iz = 1 / d.z;
    double hx = ix > 0 ? o->half.x : -o->half.x, hy = iy > 0 ? o->half.y : -o->half.y;
    double hz = iz > 0 ? o->half.z : -o->half.z;
    double x = (-hx - p.x) * ix, y = (-hy - p.y) * iy, z = (-hz - p.z) * iz;
    double in = greater(greater(x, y), z);
    if (in <= 1e-9 || in >= m->t) return;
    double out = lesser(lesser((hx - p.x) * ix, (hy - p.y) * iy), (hz - p.z) * iz);
    if (in >= out) return;
    m->object = object, m->t = in;
    m->face = in == x ? d.x > 0 : in == y ? 2 + (d.y > 0) : 4 + (d.z > 0);
}

/* Objects that may be met, and the least t of each: in its order. */
typedef struct candidates {
    int count, objects[SF_STUDIO_MAX_OBJECTS];
    double least[SF_STUDIO_MAX_OBJECTS];
} candidates;

static void add_candidate(candidates *near, int object, double least) {
    int i = near->count++;
    for (; i > 0 && near->least[i - 1] > least; i--) {
        near->objects[i] = near->objects[i - 1];
        near->least[i] = near->least[i - 1];
    }
    near->objects[i] = object;
    near->least[i] = least;
}

/* A direction without exact zeros. */
static sf_vec3 off_axis(sf_vec3 d) {
    const double least = 1e-12;
    return vec3(d.x == 0 ? least : d.x, d.y == 0 ? least : d.y, d.z == 0 ? least : d.z);
}

static void trace(const sf_studio *studio, const eye *e, const candidates *near, sf_vec3 d, met *m) {
    d = off_axis(d);
    m->object = ROOM;
    m->t = INFINITY;
    for (int i = 0; i < near->count && near->least[i] < m->t; i++) {
        int object = near->objects[i];
        const sf_object *o = &studio->objects[object];
        if (o->shape == SF_SHAPE_SPHERE)
            meet_ball(o, object, e->in[object], d, m);
        else
            meet_box(o, object, e->in[object], sf_object_turned(o, d), m);
    }
    if (m->object == ROOM) leave_room(e, d, m); /* which holds all objects */
    m->direction = m->object == ROOM ? d : sf_object_turned(&studio->objects[m->object], d);
    m->local = vat(m->object == ROOM ? e->in_room : e->in[m->object], m->t, m->direction);
}

/* 4. What it looks like */

typedef struct drawing {
    sf_baked *baked;
    const sf_camera *camera;
    eye eye;
    sf_vec3 right, down, forward; /* the camera's axes; right and down a pixel long at depth 1 */
    float *rgb, *depth;
} drawing;

static void show_ball(const sf_baked *b, const met *m, double size, float weight, float rgb[3]) {
    sf_texture_sum sum = {0, 0};
    double u, v;
    int face = face_of_ball(m->local, &u, &v);
    const sf_texture *t = &b->textures[surface_of(m->object, face)];
    sf_texture_add(t, sf_texture_level(t, size * size), u, v, &sum);
    sf_texture_mix(&sum, 1, weight, rgb);
}

/* How a step of a pixel moves the place on a flat face whose axis is `axis`, in the axes of the object. */
static sf_vec3 step_of(const sf_object *o, const met *m, int axis, double slope, sf_vec3 step) {
    sf_vec3 s = o ? sf_object_turned(o, step) : step;
    return vscale(vat(s, -get(s, axis) * slope, m->direction), m->t);
}

static void flat_position(const met *m, sf_vec3 local, sf_spot *spot) {
    sf_studio_face_position(m->object == ROOM ? m->face ^ 1 : m->face, local, spot);
}

/* Along the longer side of the pixel's trace as many samples as it is longer than the other one. */
static void show_flat(const drawing *d, const met *m, float weight, float rgb[3]) {
    enum { MOST = 3 };
    const sf_object *o = m->object == ROOM ? NULL : &d->baked->studio->objects[m->object];
    const sf_texture *t = &d->baked->textures[surface_of(m->object, m->face)];
    int axis = m->face / 2;
    double slope = 1 / get(m->direction, axis);
    sf_vec3 across = step_of(o, m, axis, slope, d->right), along = step_of(o, m, axis, slope, d->down);
    double a = vdot(across, across), l = vdot(along, along);
    if (a > l) {
        along = across;
        double size = a;
        a = l, l = size;
    }
    int n = l > 6 * a ? MOST : l > 2.2 * a ? 2 : 1;
    int level = sf_texture_level(t, greater(a, l / (MOST * MOST)));
    sf_texture_sum sum = {0, 0};
    sf_spot first, last;
    flat_position(m, vat(m->local, -0.5, along), &first);
    flat_position(m, vat(m->local, 0.5, along), &last);
    for (int i = 0; i < n; i++) {
        double at = (i + 0.5) / n;
        sf_texture_add(t, level, first.u + at * (last.u - first.u), first.v + at * (last.v - first.v), &sum);
    }
    sf_texture_mix(&sum, n, weight, rgb);
}

/* What a mirror shows, roughly as sharp as it is. */
static void show_mirrored(const drawing *d, const met *m, double size, float weight, float rgb[3]) {
    const sf_studio *studio = d->baked->studio;
    const sf_object *o = &studio->objects[m->object];
    sf_vec3 normal = vscale(m->local, 1 / o->half.x), way = vunit(m->direction);
    double facing = -vdot(way, normal), away = 1 - facing, away2 = away * away;
    double fresnel = o->mirror + (1 - o->mirror) * away2 * away2 * away;
    candidates all = {.count = 0};
    for (int i = 0; i < studio->count; i++)
        if (i != m->object) add_candidate(&all, i, 0);
    eye from;
    met second;
    eye_at(studio, vadd(o->center, m->local), &from);
    trace(studio, &from, &all, vat(way, 2 * facing, normal), &second);
    size *= 1 + 2 * second.t / o->half.x; /* a ball spreads it */
    show_ball(d->baked, m, size, weight * (float)(1 - fresnel), rgb);
    if (second.object != ROOM && studio->objects[second.object].shape == SF_SHAPE_SPHERE) {
        show_ball(d->baked, &second, size, weight * (float)fresnel, rgb);
        return;
    }
    const sf_texture *t = &d->baked->textures[surface_of(second.object, second.face)];
    sf_texture_sum mirrored = {0, 0};
    sf_spot spot;
    flat_position(&second, second.local, &spot);
    sf_texture_add(t, sf_texture_level(t, size * size), spot.u, spot.v, &mirrored);
    sf_texture_mix(&mirrored, 1, weight * (float)fresnel, rgb);
}

static void show(const drawing *d, const met *m, float weight, float rgb[3]) {
    const sf_object *o = m->object == ROOM ? NULL : &d->baked->studio->objects[m->object];
    double size = m->t / d->camera->fx;
    if (!o || o->shape == SF_SHAPE_BOX)
        show_flat(d, m, weight, rgb);
    else if (o->mirror > 0)
        show_mirrored(d, m, size, weight, rgb);
    else
        show_ball(d->baked, m, size, weight, rgb);
}

/* The direction through a picture position, as long as depth 1 is away. */
static sf_vec3 look(const drawing *d, double x_px, double y_px) {
    const sf_camera *c = d->camera;
    return vat(vat(d->forward, x_px - c->cx, d->right), y_px - c->cy, d->down);
}

/* What rays through a tile of the picture may meet. */
static void gather(const drawing *d, int x, int y, candidates *near) {
    const sf_studio *studio = d->baked->studio;
    sf_vec3 middle = look(d, x + TILE / 2.0, y + TILE / 2.0);
    double length = vlength(middle), slack = (TILE / 2.0 + 1) * 1.4143 * vlength(d->right);
    near->count = 0;
    for (int i = 0; i < studio->count; i++) {
        const sf_object *o = &studio->objects[i];
        sf_vec3 to = vsub(o->center, d->eye.at);
        double along = vdot(to, middle) / length, reach = 1.05 * (o->bound + slack * fabs(along));
        double distance = vlength(to), longest = length + slack; /* of a direction in the tile */
        if (along > -o->bound && distance * distance - along * along <= reach * reach)
            add_candidate(near, i, (distance - o->bound) / longest);
    }
}

static void draw_pixel(const drawing *d, const candidates *near, int x, int y) {
    size_t at = (size_t)y * (size_t)d->camera->width + (size_t)x;
    float *sum = d->rgb + 3 * at;
    met m;
    trace(d->baked->studio, &d->eye, near, look(d, x + 0.5, y + 0.5), &m);
    int is_ball = m.object != ROOM && d->baked->studio->objects[m.object].shape == SF_SHAPE_SPHERE;
    d->baked->surfaces[at] = (uint16_t)surface_of(m.object, is_ball ? 0 : m.face);
    if (d->depth) d->depth[at] = (float)m.t;
    sum[0] = sum[1] = sum[2] = 0;
    show(d, &m, 1, sum);
}

static int at_edge(const drawing *d, int x, int y) {
    int width = d->camera->width, height = d->camera->height;
    const uint16_t *at = d->baked->surfaces + (size_t)y * (size_t)width + (size_t)x;
    return (x > 0 && at[-1] != at[0]) || (x + 1 < width && at[1] != at[0]) ||
           (y > 0 && at[-width] != at[0]) || (y + 1 < height && at[width] != at[0]);
}

/* Pixels that show two surfaces: two rays more, at opposite corners. */
static void smooth_pixel(const drawing *d, const candidates *near, int x, int y) {
    if (!at_edge(d, x, y)) return;
    float *sum = d->rgb + 3 * ((size_t)y * (size_t)d->camera->width + (size_t)x);
    double side = (x + y) & 1 ? 0.3 : -0.3; /* the other two corners in the next pixel */
    for (int k = 0; k < 3; k++) sum[k] *= 1.0f / 3;
    for (int k = -1; k <= 1; k += 2) {
        met m;
        trace(d->baked->studio, &d->eye, near, look(d, x + 0.5 + 0.3 * k, y + 0.5 + side * k), &m);
        show(d, &m, 1.0f / 3, sum);
    }
}

static void each_pixel(const drawing *d, int row,
                       void (*pixel)(const drawing *, const candidates *, int, int)) {
    int width = d->camera->width, height = d->camera->height;
    for (int left = 0; left < width; left += TILE) {
        candidates near;
        gather(d, left, TILE * row, &near);
        for (int y = TILE * row; y < TILE * (row + 1) && y < height; y++)
            for (int x = left; x < left + TILE && x < width; x++) pixel(d, &near, x, y);
    }
}

static void draw_tiles(void *arg, size_t row, int thread) {
    (void)thread;
    each_pixel(arg, (int)row, draw_pixel);
}

static void smooth_tiles(void *arg, size_t row, int thread) {
    (void)thread;
    each_pixel(arg, (int)row, smooth_pixel);
}

void sf_baked_draw(sf_baked *baked, const sf_camera *camera, float *rgb, float *depth) {
    drawing d = {.baked = baked, .camera = camera, .rgb = rgb, .depth = depth};
    const double *R = camera->R_cw;
    double center[3];
    sf_camera_center(camera, center);
    eye_at(baked->studio, vec3(center[0], center[1], center[2]), &d.eye);
    d.right = vscale(vec3(R[0], R[1], R[2]), 1 / camera->fx);
    d.down = vscale(vec3(R[3], R[4], R[5]), 1 / camera->fy);
    d.forward = vec3(R[6], R[7], R[8]);
    size_t rows = ((size_t)camera->height + TILE - 1) / TILE;
    sf_pool_run(baked->ctx->pool, rows, draw_tiles, &d);
    sf_pool_run(baked->ctx->pool, rows, smooth_tiles, &d);
}
