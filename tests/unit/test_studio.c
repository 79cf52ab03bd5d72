/* test_studio.c - the simulated scene: what the ray caster shows agrees with the geometry, from every view.
 */
#include "../testing.h"

#include <stdlib.h>
#include <string.h>

#include "../../src/base/context.h"
#include "../../src/base/rng.h"
#include "../../src/sim/lettering.h"
#include "../../src/sim/sim.h"

static sf_sim make_sim(sf_context *ctx, const char *name) {
    sf_sim sim;
    assert_ok(ctx, sf_sim_init(ctx, name, &sim));
    return sim;
}

/* A drawn picture, linear light and depth. */
typedef struct picture {
    sf_camera camera;
    float *rgb, *depth;
} picture;

static picture draw_camera(sf_context *ctx, const sf_sim *sim, const sf_camera *camera) {
    picture p = {.camera = *camera};
    size_t pixels = (size_t)p.camera.width * (size_t)p.camera.height;
    assert_non_null(p.rgb = malloc(3 * pixels * sizeof *p.rgb));
    assert_non_null(p.depth = malloc(pixels * sizeof *p.depth));
    sf_studio_draw(&sim->studio, ctx->pool, &p.camera, p.rgb, p.depth);
    return p;
}

static picture draw(sf_context *ctx, const sf_sim *sim, uint64_t frame) {
    sf_camera camera;
    sf_sim_camera(sim, frame, &camera);
    return draw_camera(ctx, sim, &camera);
}

static void discard(picture *p) {
    free(p->rgb);
    free(p->depth);
}

/* Picture position and camera z of a world point. */
static sf_vec3 project(const sf_camera *c, sf_vec3 p) {
    const double *R = c->R_cw, *t = c->t_cw;
    sf_vec3 q = {R[0] * p.x + R[1] * p.y + R[2] * p.z + t[0], R[3] * p.x + R[4] * p.y + R[5] * p.z + t[1],
                 R[6] * p.x + R[7] * p.y + R[8] * p.z + t[2]};
    return vec3(c->fx * q.x / q.z + c->cx, c->fy * q.y / q.z + c->cy, q.z);
}

static int in_picture(const sf_camera *c, sf_vec3 at) {
    return at.z > 0 && at.x >= 0 && at.x < c->width && at.y >= 0 && at.y < c->height;
}

static int same_point(sf_vec3 a, sf_vec3 b, double tolerance) { return vlength(vsub(a, b)) <= tolerance; }

static void test_threads_do_not_matter(void **state) {
    (void)state;
    static const int threads[3] = {1, 2, 4};
    picture pictures[3];
    size_t pixels = 80 * 60;
    for (int i = 0; i < 3; i++) {
        sf_context *ctx = test_context_threads(threads[i]);
        sf_sim sim = make_sim(ctx, "sim:studio?width=80&height=60");
        pictures[i] = draw(ctx, &sim, 20);
        sf_context_destroy(&ctx);
    }
    for (int i = 1; i < 3; i++) {
        assert_memory_equal(pictures[0].rgb, pictures[i].rgb, 3 * pixels * sizeof(float));
        assert_memory_equal(pictures[0].depth, pictures[i].depth, pixels * sizeof(float));
    }
    for (int i = 0; i < 3; i++) discard(&pictures[i]);
}

/* A point on the surface of an object: on a sphere in the direction `way`, on a box at the corner that `way`
 * leads to, a little inside of the top face. */
static sf_vec3 surface_point(const sf_object *o, sf_vec3 way) {
    if (o->shape == SF_SHAPE_SPHERE) return vat(o->center, o->half.x, vunit(way));
    double x = 0.999 * o->half.x * (way.x < 0 ? -1 : 1), y = 0.999 * o->half.y * (way.y < 0 ? -1 : 1);
    return vadd(o->center, vec3(o->cos_yaw * x - o->sin_yaw * y, o->sin_yaw * x + o->cos_yaw * y, o->half.z));
}

/* Cosine between a surface's normal and the way to the camera. */
static double facing(const sf_camera *camera, sf_vec3 point, sf_vec3 normal) {
    double c[3];
    sf_camera_center(camera, c);
    return vdot(vunit(vsub(vec3(c[0], c[1], c[2]), point)), normal);
}

/* Points known from the list of objects are where the picture shows them. */
static void test_known_points(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio");
    int seen_points = 0, seen_objects[SF_STUDIO_MAX_OBJECTS] = {0};
    for (uint64_t frame = 0; frame < sim.frames; frame += 5) {
        sf_camera camera;
        sf_sim_camera(&sim, frame, &camera);
        for (int k = 0; k < 8 * sim.studio.count; k++) {
            const sf_object *o = &sim.studio.objects[k / 8];
            sf_vec3 way = {k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : 0.2};
            sf_vec3 point = surface_point(o, way), at = project(&camera, point);
            sf_vec3 normal = o->shape == SF_SHAPE_SPHERE ? vunit(way) : vec3(0, 0, 1);
            sf_hit hit;
            if (!in_picture(&camera, at) || facing(&camera, point, normal) < 0.1) continue;
            sf_studio_look(&sim.studio, &camera, at.x, at.y, &hit);
            if (!same_point(hit.point, point, 0.01)) continue; /* hidden */
            assert_int_equal(hit.object, k / 8);
            assert_true(same_point(hit.point, point, 1e-9));
            assert_true(fabs(project(&camera, hit.point).z - at.z) < 1e-9);
            seen_points++;
            seen_objects[k / 8] = 1;
        }
    }
    assert_true(seen_points > 200);
    for (int i = 0; i < sim.studio.count; i++) assert_true(seen_objects[i]);
    sf_context_destroy(&ctx);
}

/* The depth picture holds the camera z of what the pixel's middle shows. */
static void test_depth(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio?width=96&height=72");
    picture p = draw(ctx, &sim, 33);
    for (int y = 0; y < p.camera.height; y++)
        for (int x = 0; x < p.camera.width; x++) {
            sf_hit hit;
            sf_studio_look(&sim.studio, &p.camera, x + 0.5, y + 0.5, &hit);
            sf_vec3 at = project(&p.camera, hit.point);
            assert_true(fabs(at.x - x - 0.5) < 1e-9 && fabs(at.y - y - 0.5) < 1e-9);
            assert_true(fabs(at.z - (double)p.depth[y * p.camera.width + x]) < 1e-4);
        }
    discard(&p);
    sf_context_destroy(&ctx);
}

/* Rays never leave the room, whatever their direction, and meet surfaces from the front. */
static void test_room_is_closed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio");
    sf_rng rng;
    sf_rng_seed(&rng, 7);
    for (int i = 0; i < 20000; i++) {
        sf_camera camera;
        sf_sim_camera(&sim, sf_rng_below(&rng, sim.frames), &camera);
        double center[3], x = camera.width * (6 * sf_rng_uniform(&rng) - 2.5);
        double y = camera.height * (6 * sf_rng_uniform(&rng) - 2.5);
        sf_hit hit;
        sf_camera_center(&camera, center);
        sf_studio_look(&sim.studio, &camera, x, y, &hit);
        sf_vec3 from = vsub(hit.point, vec3(center[0], center[1], center[2]));
        assert_true(hit.distance > 0 && hit.distance < 20);
        assert_true(fabs(vlength(from) - hit.distance) < 1e-9);
        assert_true(fabs(vlength(hit.normal) - 1) < 1e-9);
        assert_true(vdot(from, hit.normal) < 0);
        sf_vec3 diffuse = sf_studio_diffuse(&sim.studio, &hit);
        assert_true(diffuse.x >= 0 && diffuse.y >= 0 && diffuse.z >= 0);
        assert_true(diffuse.x < 4 && diffuse.y < 4 && diffuse.z < 4);
    }
    sf_context_destroy(&ctx);
}

static int is_matt(const sf_sim *sim, const sf_hit *hit) {
    return hit->object < 0 || sim->studio.objects[hit->object].mirror == 0;
}

static double pixel_difference(const picture *a, int at_a, const picture *b, int at_b) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += fabs((double)a->rgb[3 * at_a + k] - (double)b->rgb[3 * at_b + k]);
    return sum / 3;
}

/* A matt point has the same colour from two views: exactly as scattered light, closely as pixels. */
static void test_two_views_agree(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio?width=200&height=150");
    picture a = draw(ctx, &sim, 10), b = draw(ctx, &sim, 12);
    double same = 0, other = 0;
    int count = 0, width = a.camera.width;
    for (int y = 0; y < a.camera.height; y++)
        for (int x = 0; x < width; x++) {
            sf_hit from_a, from_b;
            sf_studio_look(&sim.studio, &a.camera, x + 0.5, y + 0.5, &from_a);
            sf_vec3 at = project(&b.camera, from_a.point);
            if (!is_matt(&sim, &from_a) || !in_picture(&b.camera, at)) continue;
            sf_studio_look(&sim.studio, &b.camera, at.x, at.y, &from_b);
            if (!same_point(from_a.point, from_b.point, 1e-7)) continue;
            /* A hair beside an edge, the other view may fall on the other side: tell by the lit surface
             * alone. */
            assert_int_equal(from_a.object, from_b.object);
            int at_a = y * width + x, at_b = (int)at.y * width + (int)at.x;
            same += pixel_difference(&a, at_a, &b, at_b);
            other += pixel_difference(&a, at_a, &b, at_a);
            count++;
        }
    assert_true(count > 15000);
    assert_true(same / count < 0.05);
    assert_true(same < 0.4 * other);
    discard(&a);
    discard(&b);
    sf_context_destroy(&ctx);
}

/* Glossy things show more than the light that they scatter. Their own red is next to none: it is reflected.
 */
static void test_gloss(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio?width=160&height=120");
    picture p = draw(ctx, &sim, 30);
    double reflected = 0, brightest = 0;
    int glossy_pixels = 0;
    for (int i = 0; i < p.camera.width * p.camera.height; i++) {
        sf_hit hit;
        sf_studio_look(&sim.studio, &p.camera, i % p.camera.width + 0.5, i / p.camera.width + 0.5, &hit);
        double center[3];
        sf_camera_center(&p.camera, center);
        sf_vec3 way = vunit(vsub(vec3(center[0], center[1], center[2]), hit.point));
        if (is_matt(&sim, &hit) || vdot(way, hit.normal) < 0.4)
            continue; /* the rim mixes with what is behind */
        double red = (double)p.rgb[3 * i] - sf_studio_diffuse(&sim.studio, &hit).x;
        glossy_pixels++;
        reflected += red;
        brightest = greater(brightest, red);
    }
    assert_true(glossy_pixels > 300);
    assert_true(reflected / glossy_pixels > 0.01);
    assert_true(brightest > 0.2); /* the lamps */
    discard(&p);
    sf_context_destroy(&ctx);
}

/* A pixel is the mean of what 4 x 4 rays through it meet, at the silhouettes too. */
static void test_pixels_are_averages(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio?width=128&height=96&fov=20");
    sf_camera camera;
    sf_sim_camera(&sim, 12, &camera);
    camera.cx -= 90; /* to the right of the large glossy ball */
    picture p = draw_camera(ctx, &sim, &camera);
    int pixels = 0, off = 0;
    for (int i = 0; i < 128 * 96; i++) {
        sf_vec3 sum = {0, 0, 0};
        int matt = 1;
        for (int k = 0; k < 16; k++) {
            sf_hit hit;
            sf_studio_look(&sim.studio, &p.camera, i % 128 + (k % 4 + 0.5) / 4, i / 128 + (k / 4 + 0.5) / 4,
                           &hit);
            matt &= is_matt(&sim, &hit);
            sum = vat(sum, 1.0 / 16, sf_studio_diffuse(&sim.studio, &hit));
        }
        if (!matt) continue;
        sf_vec3 drawn = {(double)p.rgb[3 * i], (double)p.rgb[3 * i + 1], (double)p.rgb[3 * i + 2]};
        pixels++;
        off += vlength(vsub(drawn, sum)) > 0.06;
    }
    /* The draw works the light out once for a pixel and surface: where it changes fast, that differs a
     * little. */
    assert_true(pixels > 10000 && off < pixels / 1000);
    discard(&p);
    sf_context_destroy(&ctx);
}

/* What the wall opposite the path's beginning shows at x, right of the middle, and z above the floor. */
static sf_vec3 on_front_wall(const sf_sim *sim, double x, double z) {
    sf_hit hit = {.object = -1, .face = 2, .point = {x, 5.2, z}, .normal = {0, -1, 0}};
    return sf_studio_diffuse(&sim->studio, &hit);
}

/* Walls are painted to be read from inside: the poster with the white band on top hangs on the left. */
static void test_walls_are_not_mirrored(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_sim sim = make_sim(ctx, "sim:studio");
    sf_camera camera;
    sf_sim_camera(&sim, 0, &camera);
    assert_true(camera.R_cw[0] > 0.9); /* x runs to the right here */
    sf_vec3 band = on_front_wall(&sim, -1.25, 2.22), bricks = on_front_wall(&sim, 2.5, 2.22);
    assert_true(band.z > 0.6 * band.x);
    assert_true(bricks.z < 0.6 * bricks.x);
    sf_vec3 left_edge = on_front_wall(&sim, -2.18, 1.3), mirrored = on_front_wall(&sim, 2.25, 1.3);
    assert_true(left_edge.x < 0.1 && mirrored.x > 0.1); /* black frame; brick or mortar */
    sf_context_destroy(&ctx);
}

/* The next frame's bytes, without padding; free() them. */
static uint8_t *copy_frame(sf_context *ctx, sf_source *source) {
    sf_frame frame;
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    size_t row = 3 * (size_t)frame.width;
    uint8_t *copy = malloc(row * (size_t)frame.height);
    assert_non_null(copy);
    for (size_t y = 0; y < (size_t)frame.height; y++)
        memcpy(copy + y * row, frame.plane[0] + y * frame.stride[0], row);
    sf_source_release(source, &frame);
    return copy;
}

/* One pass of a Gaussian of sigma 2 px along a stride; borders repeat. */
static void blur_pass(const double *from, double *to, int width, int height, int along_y) {
    double kernel[17];
    for (int k = -8; k <= 8; k++) kernel[k + 8] = exp(-k * k / 8.0);
    for (int i = 0; i < width * height * 3; i++) {
        int channel = i % 3, x = i / 3 % width, y = i / 3 / width;
        double sum = 0, weights = 0;
        for (int k = -8; k <= 8; k++) {
            int u = along_y ? x : x + k, v = along_y ? y + k : y;
            u = u < 0 ? 0 : u >= width ? width - 1 : u;
            v = v < 0 ? 0 : v >= height ? height - 1 : v;
            sum += kernel[k + 8] * from[3 * (v * width + u) + channel];
            weights += kernel[k + 8];
        }
        to[i] = sum / weights;
    }
}

static double psnr_of_blurred(const uint8_t *rgb, int width, int height) {
    size_t n = 3 * (size_t)width * (size_t)height;
    double *sharp = malloc(n * sizeof *sharp), *half = malloc(n * sizeof *half),
           *blurred = malloc(n * sizeof *blurred);
    assert_true(sharp && half && blurred);
    for (size_t i = 0; i < n; i++) sharp[i] = rgb[i] / 255.0;
    blur_pass(sharp, half, width, height, 0);
    blur_pass(half, blurred, width, height, 1);
    double mse = 0;
    for (size_t i = 0; i < n; i++) mse += (sharp[i] - blurred[i]) * (sharp[i] - blurred[i]) / (double)n;
    free(sharp), free(half), free(blurred);
    return -10 * log10(mse);
}

/* A blurred picture must score badly, so that a good score means detail. */
static void test_blur_scores_badly(void **state) {
    (void)state;
    int views = getenv("SPLATFIT_QUICK") ? 1 : 5;
    sf_context *ctx = test_context();
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, "sim:studio?width=320&height=240&frames=5", &source));
    double mean = 0;
    for (int i = 0; i < views; i++) {
        uint8_t *rgb = copy_frame(ctx, source);
        mean += psnr_of_blurred(rgb, 320, 240) / views;
        free(rgb);
    }
    assert_true(mean < 28);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Exposed well: neither dark nor burnt out. */
static void test_exposure(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, "sim:studio?width=120&height=90&frames=3", &source));
    for (int i = 0; i < 3; i++) {
        uint8_t *rgb = copy_frame(ctx, source);
        double sum = 0;
        int burnt = 0, n = 3 * 120 * 90;
        for (int k = 0; k < n; k++) sum += rgb[k], burnt += rgb[k] == 255;
        free(rgb);
        assert_true(sum / n > 70 && sum / n < 170);
        assert_true(burnt < n / 20);
    }
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Which points of a fine grid over a letter's cell carry ink. */
static int ink_of(char letter, uint8_t grid[24 * 32]) {
    const char text[2] = {letter, 0};
    sf_line line = {text, 0, 0, 1, 0.6};
    int ink = 0;
    for (int i = 0; i < 24 * 32; i++)
        ink += grid[i] = (uint8_t)sf_lettering(&line, (i % 24) / 4.0 - 0.9, (i / 24) / 4.0 - 0.9);
    return ink;
}

static void test_letters(void **state) {
    (void)state;
    const char *letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
    uint8_t grids[36][24 * 32];
    for (int i = 0; i < 36; i++) {
        assert_true(ink_of(letters[i], grids[i]) > 80);
        for (int k = 0; k < i; k++) {
            int differ = 0;
            for (int at = 0; at < 24 * 32; at++) differ += grids[i][at] != grids[k][at];
            assert_true(differ >= 6);
        }
    }
    uint8_t blank[24 * 32];
    assert_int_equal(ink_of(' ', blank), 0);
    assert_int_equal(ink_of('~', blank), 0);
    sf_line line = {"LI", 10, 20, 2, 0.5};
    assert_true(sf_lettering(&line, 10, 31));    /* the upright of the L */
    assert_false(sf_lettering(&line, 17, 31));   /* above its foot */
    assert_true(sf_lettering(&line, 26, 26));    /* the I, six units further */
    assert_false(sf_lettering(&line, 38, 26));   /* past the text */
    assert_false(sf_lettering(&line, -1e6, 26)); /* far in front of it */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_threads_do_not_matter),
        cmocka_unit_test(test_known_points),
        cmocka_unit_test(test_depth),
        cmocka_unit_test(test_room_is_closed),
        cmocka_unit_test(test_two_views_agree),
        cmocka_unit_test(test_gloss),
        cmocka_unit_test(test_pixels_are_averages),
        cmocka_unit_test(test_walls_are_not_mirrored),
        cmocka_unit_test(test_blur_scores_badly),
        cmocka_unit_test(test_exposure),
        cmocka_unit_test(test_letters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
