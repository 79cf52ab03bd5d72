/* keyframes.c - which frames are kept, and what is done with them: the start, evaluation. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/linear.h"
#include "../fit/online.h"
#include "../scene/neighbours.h"
#include "deformation.h"
#include "live.h"

enum {
    FIRST_VIEWS = 5, /* keyframes that a fit begins with */
    ADJUSTED = 60    /* keyframes whose poses are adjusted with each new one */
};

#define MOVED          2e-5 /* rad, parts of the distance: a pose that is another one */
#define FIRST_BASELINE 0.06 /* of the distance: so far apart are the first keyframes at least */
#define FIRST_GAP      0.2  /* of the gap between keyframes, where there are none yet */
#define FULL_GAP       60   /* keyframes from which on the gap is as told */
#define SHARP          0.7  /* of the usual sharpness: enough for a keyframe */
#define PATIENCE       0.7  /* s, for a sharper one */
#define LOOK_EVERY     0.5  /* s: evaluations */
/* sRGB: value = (1 + offset) light^(1 / power) - offset */
#define SRGB_POWER  2.4
#define SRGB_OFFSET 0.055

/* 1. Pictures, small and sharp */

double sf_make_thumbnail(const sf_picture *p, float thumbnail[SF_THUMBNAIL]) {
    size_t width = (size_t)p->camera.width, height = (size_t)p->camera.height;
    double mean = 0, squares = 0;
    for (size_t ty = 0; ty < SF_THUMBNAIL_HEIGHT; ty++)
        for (size_t tx = 0; tx < SF_THUMBNAIL_WIDTH; tx++) {
            size_t x0 = tx * width / SF_THUMBNAIL_WIDTH, x1 = (tx + 1) * width / SF_THUMBNAIL_WIDTH;
            size_t y0 = ty * height / SF_THUMBNAIL_HEIGHT, y1 = (ty + 1) * height / SF_THUMBNAIL_HEIGHT;
            float sum = 0, count = 0;
            for (size_t y = y0; y < y1; y++)
                for (size_t x = x0; x < x1; x++, count++) sum += sf_picture_grey(p, y * width + x);
            thumbnail[ty * SF_THUMBNAIL_WIDTH + tx] = count > 0 ? sum / count : 0;
            mean += (double)thumbnail[ty * SF_THUMBNAIL_WIDTH + tx] / SF_THUMBNAIL;
        }
    for (int i = 0; i < SF_THUMBNAIL; i++) squares += pow((double)thumbnail[i] - mean, 2);
    for (int i = 0; i < SF_THUMBNAIL; i++)
        thumbnail[i] = squares > 1e-9 ? (float)(((double)thumbnail[i] - mean) / sqrt(squares)) : 0;
    return sqrt(squares / SF_THUMBNAIL);
}

static double likeness(const float *a, const float *b) {
    double sum = 0;
    for (int i = 0; i < SF_THUMBNAIL; i++) sum += (double)(a[i] * b[i]);
    return sum;
}

const sf_keyframe *sf_recognize_place(const sf_live *live, const float thumbnail[SF_THUMBNAIL], int rank) {
    double below = INFINITY;
    const sf_keyframe *found = NULL;
    for (int r = 0; r <= rank; r++) {
        double most = -INFINITY;
        found = NULL;
        for (size_t i = 0; i < live->keyframe_count; i++) {
            double like = likeness(thumbnail, live->keyframes[i].thumbnail);
            if (like < below && like > most) most = like, found = &live->keyframes[i];
        }
        below = most;
    }
    return found;
}

/* Mean square of the Laplacian of grey over 2 x 2 pixels, relative to the picture's own contrast: brightness
 * does not matter. */
double sf_picture_sharpness(const sf_picture *p) {
    size_t width = (size_t)p->camera.width, height = (size_t)p->camera.height;
    double edges = 0, sum = 0, squares = 0, count = 0;
    for (size_t y = 2; y + 2 < height; y += 2)
        for (size_t x = 2; x + 2 < width; x += 2, count++) {
            size_t at = y * width + x;
            double g = (double)sf_picture_grey(p, at);
            double l = 4 * g - (double)(sf_picture_grey(p, at - 2) + sf_picture_grey(p, at + 2)) -
                       (double)(sf_picture_grey(p, at - 2 * width) + sf_picture_grey(p, at + 2 * width));
            edges += l * l, sum += g, squares += g * g;
        }
    double variance = count > 0 ? squares / count - pow(sum / count, 2) : 0;
    return variance > 1e-6 ? edges / count / variance : 0;
}

/* 2. Which frames are kept */

/* How far a pose is from a keyframe: the greater of the move, in distances to what is seen, and the turn,
 * rad. */
static double gap_to(const sf_live *live, const sf_keyframe *k, const sf_rigid *pose,
                     const double center[3]) {
    double twist[6], apart = 0;
    sf_rigid_twist(&k->pose, pose, twist);
    for (int i = 0; i < 3; i++) apart += pow(k->center[i] - center[i], 2);
    return fmax(sqrt(apart) / fmax(live->distance, 1e-9), sqrt(sf_dot3(twist + 3, twist + 3)));
}

static double least_gap(const sf_live *live, const sf_rigid *pose, const double center[3], size_t but) {
    double least = INFINITY;
    for (size_t i = 0; i < live->keyframe_count; i++)
        if (i != but) least = fmin(least, gap_to(live, &live->keyframes[i], pose, center));
    return least;
}

/* Of those that are trained on, but the first and the newest, the one that another stands in for best. */
static size_t most_redundant(const sf_live *live) {
    size_t found = 1;
    double least = INFINITY;
    for (size_t i = 1; i + SF_LIVE_RECENT < live->keyframe_count; i++) {
        const sf_keyframe *k = &live->keyframes[i];
        double gap = k->held_out ? INFINITY : least_gap(live, &k->pose, k->center, i);
        if (gap < least) least = gap, found = i;
    }
    return found;
}

static sf_status make_room(sf_live *live) {
    if (live->keyframe_count >= (size_t)live->options.keyframes_most) {
        size_t gone = most_redundant(live);
        sf_status status = sf_scene_remove_view(live->scene, live->keyframes[gone].id);
        if (status) return status;
        sf_landmarks_drop(live->landmarks, live->keyframes[gone].id);
        live->keyframe_count--;
        memmove(live->keyframes + gone, live->keyframes + gone + 1,
                (live->keyframe_count - gone) * sizeof *live->keyframes);
    }
    return sf_grow(live->ctx, &live->keyframes, &live->keyframe_capacity, live->keyframe_count,
                   live->keyframe_count + 1, sizeof *live->keyframes);
}

static sf_status add_view(sf_live *live, sf_split split, uint32_t *id) {
    const sf_picture *p = live->picture;
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    uint8_t *rgb = live->bytes, *mask = live->bytes + 3 * pixels;
    for (size_t i = 0; i < pixels; i++) {
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = (uint8_t)(255 * fminf(fmaxf(p->rgb[c][i], 0), 1) + 0.5f);
        if (p->weight) mask[i] = (uint8_t)(255 * p->weight[i] + 0.5f);
    }
    sf_pixels given = {rgb, 3 * (size_t)p->camera.width, p->weight ? mask : NULL};
    return sf_scene_add_view(live->scene, NULL, &live->frame.camera, &given, split, id);
}

sf_camera sf_live_camera_at(const sf_live *live, const sf_rigid *pose) {
    sf_camera camera = live->frame.camera;
    memcpy(camera.R_cw, pose->R, sizeof pose->R), memcpy(camera.t_cw, pose->t, sizeof pose->t);
    return camera;
}

/* A keyframe's pose as it is known by now. */
static sf_status correct(sf_live *live, sf_keyframe *k, const sf_rigid *pose) {
    sf_camera camera = sf_live_camera_at(live, pose);
    k->pose = *pose;
    sf_camera_center(&camera, k->center);
    if (live->fitter && sf_online_has_view(live->fitter, k->id)) /* else it comes with the view */
        (void)sf_fitter_set_pose(live->fitter, k->id, pose->R, pose->t);
    return sf_scene_set_pose(live->scene, k->id, pose->R, pose->t);
}

static int has_moved(const sf_live *live, const sf_rigid *from, const sf_rigid *to) {
    double twist[6];
    sf_rigid_twist(from, to, twist);
    return sqrt(sf_dot3(twist + 3, twist + 3)) > MOVED ||
           sqrt(sf_dot3(twist, twist)) > MOVED * live->distance;
}

/* All poses that are known better by now follow. corrections[count]: of the keyframes but the newest, which
 * nothing was fitted to yet. */
static sf_status correct_all(sf_live *live, uint32_t newest, sf_correction *corrections, size_t *count) {
    sf_status status = SF_OK;
    *count = 0;
    for (size_t i = 0; !status && i < live->keyframe_count; i++) {
        sf_keyframe *k = &live->keyframes[i];
        sf_correction *c = &corrections[*count];
        sf_rigid pose;
        c->camera = sf_live_camera_at(live, &k->pose);
        if (sf_landmarks_pose(live->landmarks, k->id, &pose) && has_moved(live, &k->pose, &pose)) {
            if (k->id == newest) sf_live_correct_pose(live, &k->pose, &pose);
            status = correct(live, k, &pose);
        }
        c->to = k->pose;
        *count += k->id != newest;
    }
    return status;
}

/* The newest keyframe joins the landmarks; poses, and the model with them, go where it moves them. */
static sf_status adjust(sf_live *live, uint32_t id) {
    const sf_track_prior *known = live->fix.from ? &live->fix.prior : NULL;
    sf_status status =
        sf_landmarks_keep(live->landmarks, id, &live->pose, known, live->distance, live->picture->weight);
    if (!status) status = sf_landmarks_adjust(live->landmarks, ADJUSTED);
    sf_correction *corrections = sf_alloc(live->ctx, live->keyframe_count, sizeof *corrections);
    size_t count;
    if (!status && !corrections) status = SF_ERR_MEMORY;
    if (!status) status = correct_all(live, id, corrections, &count);
    if (!status && live->fitter) status = sf_deform_fit(live->ctx, live->fitter, corrections, count);
    sf_free(live->ctx, corrections);
    return status;
}

static sf_status take_keyframe(sf_live *live) {
    int64_t every = live->options.hold_out;
    sf_status status = make_room(live);
    if (status) return status;
    sf_keyframe k = {.psnr = NAN, .psnr_corrected = NAN, .pose = live->pose};
    k.held_out = every > 0 && live->keyframes_made % every == every / 2;
    sf_camera_center(&live->frame.camera, k.center);
    memcpy(k.thumbnail, live->thumbnail, sizeof k.thumbnail);
    status = add_view(live, k.held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, &k.id);
    if (status) return status;
    k.hold = live->fixed;
    k.light = live->picture->light;
    live->keyframes[live->keyframe_count++] = k;
    live->keyframes_made++;
    live->wanted = 0;
    return adjust(live, k.id);
}

sf_status sf_live_offer_keyframe(sf_live *live, int *taken) {
    double now = 1e-9 * (double)live->picture->time_ns, gap = live->options.keyframe_gap, center[3];
    *taken = 0;
    if (live->frame.from == SF_POSE_NONE || !live->sure || !(live->distance > 0)) return SF_OK;
    double grown =
        fmin(1, (double)live->keyframe_count / FULL_GAP); /* where there are few, one more costs little */
    gap *= FIRST_GAP + (1 - FIRST_GAP) * grown;
    sf_camera_center(&live->frame.camera, center);
    if (least_gap(live, &live->pose, center, SIZE_MAX) < gap) {
        live->wanted = 0;
        return SF_OK;
    }
    if (!live->wanted) live->wanted = 1, live->wanted_since = now;
    if (live->unlike < SHARP && now - live->wanted_since < PATIENCE) return SF_OK;
    sf_status status = take_keyframe(live);
    *taken = !status;
    return status;
}

/* The mean of the logarithms of what light the training keyframes had. NAN: of one it is not known. */
static double usual_light(const sf_live *live) {
    double sum = 0, n = 0;
    for (size_t i = 0; i < live->keyframe_count; i++)
        if (!live->keyframes[i].held_out) sum += log(live->keyframes[i].light), n++;
    return isfinite(sum) && n > 0 ? sum / n : NAN;
}

/* What light does to values in sRGB, but for its darkest. Where all began alike each new picture taught the
 * model its own exposure where nothing else was seen, and a path through brighter and darker places ended in
 * colours that go with the exposures along it. 0, and nothing changes: the light is not known. */
static int exposure_of_light(const sf_live *live, const sf_keyframe *k, double gain[3], double bias[3]) {
    double usual = usual_light(live), by = exp((log(k->light) - usual) / SRGB_POWER);
    for (int c = 0; c < 3 && !isnan(usual); c++) gain[c] = by, bias[c] = SRGB_OFFSET * (by - 1);
    return !isnan(usual);
}

/* What a keyframe shows as the training keyframes do that were taken before and after it: the mean of what
 * was learned of them, in the light that it had. 0, and nothing changes: there are none. */
static int exposure_of_neighbours(const sf_live *live, size_t at, double gain[3], double bias[3]) {
    double log_gain[3] = {0}, sum[3] = {0};
    int n = 0;
    for (int way = -1; way <= 1; way += 2) {
        size_t i = at + (size_t)way; /* past 0 it wraps */
        while (i < live->keyframe_count && !live->keyframes[i].told) i += (size_t)way;
        if (i >= live->keyframe_count) continue;
        double g[3] = {1, 1, 1}, b[3] = {0};
        double by = exp(log(live->keyframes[at].light / live->keyframes[i].light) / SRGB_POWER);
        if (isnan(by)) by = 1;
        (void)sf_fitter_get_exposure(live->fitter, live->keyframes[i].id, g, b);
        for (int c = 0; c < 3; c++)
            log_gain[c] += log(by * g[c]), sum[c] += by * b[c] + SRGB_OFFSET * (by - 1);
        n++;
    }
    for (int c = 0; c < 3 && n; c++) gain[c] = exp(log_gain[c] / n), bias[c] = sum[c] / n;
    return n > 0;
}

/* Before it is learned. */
static int first_exposure(const sf_live *live, size_t at, double gain[3], double bias[3]) {
    return exposure_of_light(live, &live->keyframes[at], gain, bias) ||
           exposure_of_neighbours(live, at, gain, bias);
}

void sf_live_exposure(const sf_live *live, uint32_t id, double gain[3], double bias[3]) {
    size_t at = live->keyframe_count;
    for (int c = 0; c < 3; c++) gain[c] = 1, bias[c] = 0;
    while (at && live->keyframes[at - 1].id != id) at--;
    if (!at || !live->options.fit.exposure) return;
    if (live->keyframes[at - 1].told)
        (void)sf_fitter_get_exposure(live->fitter, id, gain, bias);
    else
        (void)first_exposure(live, at - 1, gain, bias);
}

void sf_live_tell_fit(sf_live *live) {
    for (size_t i = live->keyframe_count; i--;) {
        sf_keyframe *k = &live->keyframes[i];
        if (k->told || k->held_out || !sf_online_has_view(live->fitter, k->id)) continue;
        if (k->hold) (void)sf_fitter_hold_pose(live->fitter, k->id);
        double gain[3], bias[3];
        if (first_exposure(live, i, gain, bias))
            (void)sf_fitter_set_exposure(live->fitter, k->id, gain, bias);
        k->told = 1;
    }
}

/* 3. The start */

/* The largest distance between two keyframes that are trained on, in distances to what they see. */
static double baseline(const sf_live *live, size_t *count) {
    double most = 0;
    *count = 0;
    for (size_t i = 0; i < live->keyframe_count; i++) {
        const sf_keyframe *a = &live->keyframes[i];
        *count += !a->held_out;
        for (size_t j = 0; j < i && !a->held_out; j++) {
            double apart = 0;
            for (int k = 0; k < 3; k++) apart += pow(a->center[k] - live->keyframes[j].center[k], 2);
            if (!live->keyframes[j].held_out) most = fmax(most, sqrt(apart));
        }
    }
    return most / fmax(live->distance, 1e-9);
}

sf_status sf_live_begin(sf_live *live) {
    size_t views;
    double apart = baseline(live, &views);
    live->state = SF_LIVE_STARTING;
    if (views < FIRST_VIEWS || apart < FIRST_BASELINE) return SF_OK;
    sf_fit_options o = live->options.fit;
    if (!(o.extent > 0)) o.extent = live->distance;
    if (o.time_limit > 0) o.time_limit = fmax(o.time_limit - (sf_clock() - live->first_frame), 1);
    sf_status status = sf_fitter_create(live->ctx, live->scene, NULL, &o, &live->fitter);
    if (!status) live->state = SF_LIVE_TRACKING;
    for (size_t i = 0; i < live->keyframe_count && !status; i++)
        live->keyframes[i].searched = 1; /* as a whole */
    return status;
}

/* 4. How good it is */

static sf_status quality_of(sf_live *live, size_t at, sf_quality *quality) {
    sf_camera camera;
    double gain[3], bias[3];
    uint32_t id = live->keyframes[at].id;
    sf_status status = sf_fitter_get_camera(live->fitter, id, &camera);
    size_t pixels = (size_t)camera.width * (size_t)camera.height;
    if (status) return status;
    float *rgb = sf_alloc(live->ctx, 7 * pixels, sizeof *rgb);
    if (!rgb) return SF_ERR_MEMORY;
    sf_image_out out = {.rgb = rgb};
    status = sf_scene_get_pixels(live->scene, id, rgb + 3 * pixels, rgb + 6 * pixels);
    if (!status) status = sf_fitter_render(live->fitter, &camera, &out);
    if (!status)
        status = sf_compare(live->renderer, camera.width, camera.height, rgb, rgb + 3 * pixels,
                            rgb + 6 * pixels, quality);
    int exposes = live->keyframes[at].held_out && live->options.fit.exposure;
    if (!status && exposes && exposure_of_neighbours(live, at, gain, bias)) {
        double corrected = quality->psnr_corrected; /* as drawn: an exposure has no more to say of it */
        for (size_t i = 0; i < 3 * pixels; i++) rgb[i] = (float)(gain[i % 3] * (double)rgb[i] + bias[i % 3]);
        status = sf_compare(live->renderer, camera.width, camera.height, rgb, rgb + 3 * pixels,
                            rgb + 6 * pixels, quality);
        quality->psnr_corrected = corrected;
    }
    sf_free(live->ctx, rgb);
    return status == SF_ERR_EMPTY ? SF_OK : status;
}

/* The first keyframe and those held out; others are not looked at. */
static sf_status look_at_keyframe(sf_live *live, size_t at) {
    sf_keyframe *k = &live->keyframes[at];
    sf_quality quality = {NAN, NAN, NAN};
    if (at && !k->held_out) return SF_OK;
    sf_status status = quality_of(live, at, &quality);
    k->psnr = quality.psnr, k->psnr_corrected = quality.psnr_corrected;
    return status;
}

sf_status sf_live_evaluate(sf_live *live) {
    double now = sf_clock();
    if (!live->fitter || !live->keyframe_count || now < live->evaluated + LOOK_EVERY) return SF_OK;
    live->evaluated = now;
    for (size_t i = 0; i < live->keyframe_count; i++) {
        size_t at = live->evaluate_next++ % live->keyframe_count;
        if (!at || live->keyframes[at].held_out) return look_at_keyframe(live, at);
    }
    return SF_OK;
}

sf_status sf_live_evaluate_all(sf_live *live) {
    sf_status status = SF_OK;
    for (size_t i = 0; i < live->keyframe_count && live->fitter && !status; i++)
        status = look_at_keyframe(live, i);
    return status;
}
