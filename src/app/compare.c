/* compare.c - two models rendered from the same places: how much one differs from the other. */
#include "compare.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* The ring: its cameras stand at RING_DISTANCE times the model's radius from its centre, a little above it
 * (-y is up), and look at it. */
#define RING_DISTANCE 2.0
#define RING_HEIGHT   0.5
enum { RING_WIDTH = 480, RING_HEIGHT_PX = 360 };

const arg_option compare_options[] = {
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {"near-plane", 0, "X", "cull Gaussians nearer than X, world units; default: as a fit of the project"},
    {0},
};

typedef struct job {
    sf_context *ctx;
    sf_renderer *renderer;
    const sf_model *models[2];
    sf_render_options options;
    comparison *result;
} job;

/* ---- One view ---- */

static sf_status add_picture(const job *j, sf_scene *scene, const sf_view_info *view, float *const drawn[2],
                             compared_views *sum) {
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    float *truth = malloc(4 * pixels * sizeof *truth), *weight = truth + 3 * pixels;
    double *const psnr[2] = {&sum->psnr_first, &sum->psnr_second};
    sf_status status = truth ? sf_scene_get_pixels(scene, view->id, truth, weight) : SF_ERR_MEMORY;
    for (int i = 0; i < 2 && !status; i++) {
        sf_quality q = {0};
        status = sf_compare(j->renderer, view->camera.width, view->camera.height, drawn[i], truth,
                            view->has_mask ? weight : NULL, &q);
        if (status == SF_ERR_EMPTY) status = SF_OK; /* masked altogether */
        *psnr[i] += q.psnr;
    }
    free(truth);
    return status;
}

static sf_status add_renders(const job *j, const sf_camera *camera, const char *name, float *const drawn[2],
                             compared_views *sum) {
    sf_quality q;
    sf_status status = SF_OK;
    for (int i = 0; i < 2 && !status; i++) {
        sf_image_out out = {.rgb = drawn[i]};
        status = sf_render(j->renderer, j->models[i], camera, &j->options, &out);
    }
    /* The first one's render stands for a picture. */
    size_t values = 3 * (size_t)camera->width * (size_t)camera->height;
    for (size_t i = 0; i < values; i++) drawn[0][i] = fmaxf(0, fminf(drawn[0][i], 1));
    if (!status)
        status = sf_compare(j->renderer, camera->width, camera->height, drawn[1], drawn[0], NULL, &q);
    if (status) return status;
    sum->views++;
    sum->psnr += q.psnr;
    sum->ssim += q.ssim;
    json_array_append_new(j->result->list, json_pack("{s:o, s:f, s:f}", "name", app_json_text(name), "psnr",
                                                     q.psnr, "ssim", q.ssim));
    return SF_OK;
}

/* A view of a scene, or (scene NULL) a camera alone. */
static sf_status add_view(const job *j, sf_scene *scene, const sf_view_info *view, compared_views *sum) {
    size_t values = 3 * (size_t)view->camera.width * (size_t)view->camera.height;
    float *block = malloc(2 * values * sizeof *block);
    float *const drawn[2] = {block, block + values};
    sf_status status = block ? add_renders(j, &view->camera, view->name, drawn, sum) : SF_ERR_MEMORY;
    if (!status && scene) status = add_picture(j, scene, view, drawn, sum);
    free(block);
    return status;
}

/* ---- Which views ---- */

static sf_status over_scene(const job *j, sf_scene *scene) {
    comparison *r = j->result;
    sf_scene_info info;
    sf_status status = SF_OK;
    sf_scene_get_info(scene, &info);
    r->kinds[0].name = "held out";
    r->kinds[1].name = "to train on";
    r->number = 2;
    for (size_t i = 0; i < info.views && !status; i++) {
        sf_view_info view;
        status = sf_scene_get_view(scene, i, &view);
        if (!status) status = add_view(j, scene, &view, &r->kinds[view.split != SF_SPLIT_TEST]);
    }
    return status;
}

/* The i-th camera of the ring: rows of R are its right, down and forward. */
static sf_camera ring_camera(int i, const double center[3], double extent) {
    const double tau = 6.283185307179586, angle = tau * i / COMPARE_RING, c = cos(angle), s = sin(angle);
    double norm = sqrt(1 + RING_HEIGHT * RING_HEIGHT), flat = 1 / norm, tilt = RING_HEIGHT / norm;
    double distance = RING_DISTANCE * extent;
    const double R[9] = {c, 0, -s, -tilt * s, flat, -tilt * c, flat * s, tilt, flat * c};
    sf_camera camera = {.width = RING_WIDTH, .height = RING_HEIGHT_PX};
    camera.fx = camera.fy = RING_HEIGHT_PX;
    camera.cx = RING_WIDTH / 2.0;
    camera.cy = RING_HEIGHT_PX / 2.0;
    for (int r = 0; r < 3; r++) {
        double t = r == 2 ? distance : 0;
        for (int k = 0; k < 3; k++) {
            camera.R_cw[3 * r + k] = R[3 * r + k];
            t -= R[3 * r + k] * center[k];
        }
        camera.t_cw[r] = t;
    }
    return camera;
}

static sf_status over_ring(job *j, int near_plane_given) {
    sf_model_bounds bounds;
    sf_status status = sf_model_get_bounds(j->models[0], &bounds);
    if (status == SF_ERR_EMPTY) status = SF_OK; /* nothing is seen, and alike */
    if (!near_plane_given) j->options.near_plane = (float)(bounds.radius / 100);
    j->result->kinds[0].name = "ring";
    j->result->number = 1;
    for (int i = 0; i < COMPARE_RING && !status; i++) {
        char name[16];
        snprintf(name, sizeof name, "ring-%d", i);
        sf_view_info view = {.name = name, .camera = ring_camera(i, bounds.center, bounds.radius)};
        status = add_view(j, NULL, &view, &j->result->kinds[0]);
    }
    return status;
}

static void take_means(compared_views *v) {
    double n = v->views ? (double)v->views : 1;
    v->psnr /= n;
    v->ssim /= n;
    v->psnr_first /= n;
    v->psnr_second /= n;
}

int compare_models(const args *a, sf_context *ctx, const sf_model *first, const sf_model *second,
                   sf_scene *scene, comparison *result) {
    *result = (comparison){.list = json_array()};
    job j = {.ctx = ctx, .models = {first, second}, .options = sf_render_options_default(), .result = result};
    int error = app_render_options(a, &j.options);
    if (error) return error;
    sf_status status = sf_renderer_create(ctx, &j.renderer);
    if (!status) status = scene ? over_scene(&j, scene) : over_ring(&j, args_value(a, "near-plane") != NULL);
    sf_renderer_destroy(&j.renderer);
    for (int i = 0; i < 2; i++) take_means(&result->kinds[i]);
    return status ? app_fail(a, ctx) : 0;
}

void compare_free(comparison *result) { json_decref(result->list); }

/* ---- The result ---- */

void compare_print(const comparison *result) {
    for (int i = 0; i < result->number; i++) {
        const compared_views *v = &result->kinds[i];
        if (!v->views) continue;
        if (result->number == 1)
            printf("%zu views from a ring around the model", v->views);
        else
            printf("%zu views %s", v->views, v->name);
        printf(": PSNR %.2f dB, SSIM %.4f between the renders of both", v->psnr, v->ssim);
        if (v->psnr_first > 0)
            printf("; to the pictures %.2f dB, before %.2f dB", v->psnr_second, v->psnr_first);
        printf("\n");
    }
}

json_t *compare_json(const comparison *result) {
    json_t *kinds = json_array();
    for (int i = 0; i < result->number; i++) {
        const compared_views *v = &result->kinds[i];
        if (v->views)
            json_array_append_new(kinds, json_pack("{s:s, s:I, s:f, s:f, s:f, s:f}", "views", v->name,
                                                   "number", (json_int_t)v->views, "psnr", v->psnr, "ssim",
                                                   v->ssim, "psnr_to_pictures_before", v->psnr_first,
                                                   "psnr_to_pictures", v->psnr_second));
    }
    return json_pack("{s:o, s:O}", "means", kinds, "views", result->list);
}
