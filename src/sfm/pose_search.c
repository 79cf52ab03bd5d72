/* pose_search.c - see pose_search.h. */
#include "pose_search.h"

#include <math.h>
#include <string.h>

int sf_pose_search_make(sf_context *ctx, size_t most, const sf_lens *lens, sf_pose_search *s) {
    *s = (sf_pose_search){.lens = *lens};
    s->points = sf_alloc(ctx, 9 * most + 1, sizeof *s->points);
    s->members = sf_alloc(ctx, most + 1, sizeof *s->members);
    if (!s->points || !s->members) return 0;
    s->pixels = s->points + 3 * most, s->rays = s->pixels + 2 * most, s->scratch = s->rays + 2 * most;
    s->all = (sf_correspondences){s->points, s->pixels, 0};
    return 1;
}

void sf_pose_search_free(sf_context *ctx, sf_pose_search *s) {
    sf_free(ctx, s->points);
    sf_free(ctx, s->members);
    *s = (sf_pose_search){.scratch = NULL};
}

void sf_pose_search_add(sf_pose_search *s, const double point[3], const double pixel[2]) {
    size_t n = s->all.count++;
    memcpy(s->points + 3 * n, point, 3 * sizeof *point);
    memcpy(s->pixels + 2 * n, pixel, 2 * sizeof *pixel);
}

/* The rays through the lens; a pixel without one gets that of a pinhole. */
static void make_rays(sf_pose_search *s) {
    for (size_t i = 0; i < s->all.count; i++) {
        const double *pixel = s->pixels + 2 * i;
        if (sf_lens_ray(&s->lens, pixel, s->rays + 2 * i)) continue;
        s->rays[2 * i] = (pixel[0] - s->lens.cx) / s->lens.fx;
        s->rays[2 * i + 1] = (pixel[1] - s->lens.cy) / s->lens.fy;
    }
}

/* The model of the search: a pose, as sf_rigid. */

typedef struct problem {
    const sf_pose_search *s;
    double scale; /* px: of the weights of a refinement */
} problem;

static int solve(const void *user, const uint32_t *sample, double *models) {
    const sf_pose_search *s = ((const problem *)user)->s;
    sf_rigid poses[SF_P3P_MOST];
    int count = sf_pose_from_3(s->points, s->rays, sample, poses);
    for (int k = 0; k < count; k++) {
        memcpy(models + (size_t)(12 * k), poses[k].R, sizeof poses[k].R);
        memcpy(models + (size_t)(12 * k + 9), poses[k].t, sizeof poses[k].t);
    }
    return count;
}

static sf_rigid pose_of(const double *model) {
    sf_rigid T;
    memcpy(T.R, model, sizeof T.R);
    memcpy(T.t, model + 9, sizeof T.t);
    return T;
}

sf_rigid sf_pose_search_pose(const sf_ransac_result *found) { return pose_of(found->model); }

static int refit(const void *user, double *weights, double *model) {
    const problem *p = user;
    const sf_pose_search *s = p->s;
    sf_rigid T = pose_of(model);
    sf_lens lens = s->lens;
    size_t count = 0;
    for (uint32_t i = 0; i < s->all.count; i++)
        if (weights[i] != 0) s->members[count++] = i;
    if (count < 4 || !isfinite(sf_pose_refine(&s->all, s->members, count, p->scale, 0, &lens, &T))) return 0;
    memcpy(model, T.R, sizeof T.R);
    memcpy(model + 9, T.t, sizeof T.t);
    return 1;
}

static void find_errors(const sf_pose_search *s, const sf_rigid *T, size_t begin, size_t end,
                        double *squared) {
    for (size_t i = begin; i < end; i++) {
        double p[3], pixel[2];
        sf_rigid_apply(T, s->points + 3 * i, p);
        squared[i - begin] = INFINITY;
        if (!sf_lens_project(&s->lens, p, pixel, NULL, NULL)) continue;
        double x = pixel[0] - s->pixels[2 * i], y = pixel[1] - s->pixels[2 * i + 1];
        squared[i - begin] = x * x + y * y;
    }
}

static void errors(const void *user, const double *model, size_t begin, size_t end, double *squared) {
    const sf_rigid T = pose_of(model);
    find_errors(((const problem *)user)->s, &T, begin, end, squared);
}

void sf_pose_search_run(sf_pose_search *s, const sf_pose_search_options *o, sf_ransac_result *found) {
    const problem user = {s, o->error_px / 2};
    const sf_ransac_problem wanted = {&user, s->all.count, 3, 12, solve, refit, errors};
    const sf_ransac_options options = {.threshold = o->error_px,
                                       .confidence = 0.9999,
                                       .least = 10,
                                       .most = 2000,
                                       .least_count = o->least,
                                       .seed = o->seed};
    make_rays(s);
    sf_ransac(&wanted, &options, s->scratch, NULL, found);
}

size_t sf_pose_search_refine(sf_pose_search *s, const sf_pose_search_options *o, int with_focal,
                             sf_rigid *T) {
    size_t count = 0;
    for (int round = 0; round < 3; round++) {
        find_errors(s, T, 0, s->all.count, s->scratch);
        count = 0;
        for (uint32_t i = 0; i < s->all.count; i++)
            if (s->scratch[i] <= o->error_px * o->error_px) s->members[count++] = i;
        if (count < o->least) return 0;
        sf_pose_refine(&s->all, s->members, count, o->error_px / 2, with_focal, &s->lens, T);
    }
    return count;
}
