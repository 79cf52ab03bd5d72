/* save_colmap.c - what was reconstructed: its figures, and COLMAP's binary files. */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../io/colmap_write.h"
#include "../pose/lens.h"
#include "photo_cameras.h"
#include "reasons.h"

#include <splatfit/camera.h>

/* ---- Figures ---- */

static double squared_error(const sf_map *map, size_t observation, size_t track) {
    const sf_track_observation *s = &map->tracks.observations[observation];
    const sf_map_picture *picture = &map->pictures[s->picture];
    double point[3], pixel[2];
    sf_rigid_apply(&picture->pose, map->at[track], point);
    if (!sf_lens_project(&map->cameras[picture->camera].lens, point, pixel, NULL, NULL)) return INFINITY;
    const double *seen = picture->keypoints + 2 * (size_t)s->keypoint;
    return pow(pixel[0] - seen[0], 2) + pow(pixel[1] - seen[1], 2);
}

/* The observations that a track's point was made from. Returns how many. */
static size_t used(const sf_map *map, size_t track, double *squares) {
    size_t count = 0;
    if (!map->has_point[track]) return 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        if (!map->is_used[i] || !map->pictures[map->tracks.observations[i].picture].is_placed) continue;
        *squares += squared_error(map, i, track);
        count++;
    }
    return count;
}

void sf_reconstruction_get_info(const sf_reconstruction *r, sf_reconstruction_info *info) {
    double squares = 0;
    *info = (sf_reconstruction_info){.photos = r->list.count,
                                     .masks = r->list.masks,
                                     .placed = r->map->placed_count,
                                     .other_places = r->map->other_maps,
                                     .other_photos = r->map->other_pictures};
    for (size_t track = 0; track < r->map->tracks.count; track++) {
        size_t count = used(r->map, track, &squares);
        info->points += count > 0;
        info->observations += count;
    }
    info->error = info->observations ? sqrt(squares / (double)info->observations) : 0;
    memcpy(info->seconds, r->seconds, sizeof info->seconds);
}

static size_t observations_of(const sf_map *map, size_t picture) {
    size_t count = 0;
    const sf_map_picture *p = &map->pictures[picture];
    for (size_t k = 0; k < p->count; k++) {
        uint32_t track = p->track_of[k];
        if (track == UINT32_MAX || !map->has_point[track]) continue;
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
            count += map->is_used[i] && map->tracks.observations[i].picture == picture;
    }
    return count;
}

sf_status sf_reconstruction_get_photo(const sf_reconstruction *r, size_t index,
                                      sf_reconstruction_photo *photo) {
    if (index >= r->list.count)
        return sf_fail(r->ctx, SF_ERR_ARGUMENT, "index: there is no photo %zu", index);
    const sf_map_picture *picture = &r->map->pictures[index];
    const sf_photo_file *file = &r->list.photos[index];
    *photo = (sf_reconstruction_photo){
        .name = file->name,
        .placed = picture->is_placed,
        .why = picture->is_placed ? "" : sf_photo_why_not(r, index),
        .features = file->features.count,
        .width = file->width,
        .height = file->height,
        .camera = picture->camera,
        .focal_told = r->map->cameras[picture->camera].focal_told,
        .lens = sf_photo_lens(&r->map->cameras[picture->camera], r->is_turned[index])};
    if (!picture->is_placed) return SF_OK;
    photo->observations = observations_of(r->map, index);
    sf_rigid pose = sf_photo_pose(r, index, &picture->pose);
    memcpy(photo->R_cw, pose.R, sizeof photo->R_cw);
    memcpy(photo->t_cw, pose.t, sizeof photo->t_cw);
    return SF_OK;
}

/* ---- Files ---- */

static void put_camera(sf_writer *w, uint32_t id, const sf_map_camera *camera, uint32_t is_turned) {
    const sf_lens lens = sf_photo_lens(camera, is_turned != 0);
    int32_t width = is_turned ? camera->height : camera->width,
            height = is_turned ? camera->width : camera->height;
    sf_colmap_put_camera(w, id, width, height, &lens);
}

/* Whether a camera has photos upright, or on their side. */
static int has_photos(const sf_reconstruction *r, uint32_t camera, uint32_t is_turned) {
    for (size_t i = 0; i < r->list.count; i++)
        if (!*r->list.photos[i].fault && r->camera_of[i] == camera && r->is_turned[i] == is_turned) return 1;
    return 0;
}

/* Those on their side come after all others. COLMAP counts from 1. */
static uint32_t id_of(const sf_reconstruction *r, uint32_t camera, uint32_t is_turned) {
    return camera + 1 + (is_turned ? (uint32_t)r->camera_count : 0);
}

static void put_cameras(sf_writer *w, const void *reconstruction) {
    const sf_reconstruction *r = reconstruction;
    uint32_t count = 0, both = 2 * (uint32_t)r->camera_count;
    for (uint32_t c = 0; c < both; c++) count += (uint32_t)has_photos(r, c / 2, c % 2);
    sf_colmap_put_count(w, count);
    for (uint32_t c = 0; c < both; c++)
        if (has_photos(r, c / 2, c % 2))
            put_camera(w, id_of(r, c / 2, c % 2), &r->map->cameras[c / 2], c % 2);
}

/* A feature's point, as an id; UINT64_MAX: it has none. */
static uint64_t point_of(const sf_map *map, size_t picture, size_t feature) {
    uint32_t track = map->pictures[picture].track_of[feature];
    if (track == UINT32_MAX || !map->has_point[track]) return UINT64_MAX;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        const sf_track_observation *s = &map->tracks.observations[i];
        if (s->picture == picture && s->keypoint == feature) return map->is_used[i] ? track + 1u : UINT64_MAX;
    }
    return UINT64_MAX;
}

static void put_images(sf_writer *w, const void *reconstruction) {
    const sf_reconstruction *r = reconstruction;
    sf_colmap_put_count(w, r->map->placed_count);
    for (size_t i = 0; i < r->list.count; i++) {
        const sf_map_picture *p = &r->map->pictures[i];
        const sf_features *f = &r->list.photos[i].features;
        if (!p->is_placed) continue;
        const sf_rigid pose = sf_photo_pose(r, i, &p->pose);
        sf_colmap_put_image(w, &(sf_colmap_image){.id = (uint32_t)i + 1,
                                                  .camera = id_of(r, p->camera, r->is_turned[i]),
                                                  .R_cw = pose.R,
                                                  .t_cw = pose.t,
                                                  .name = r->list.photos[i].name,
                                                  .features = p->count});
        for (size_t k = 0; k < p->count; k++)
            sf_colmap_put_feature(w, (double)f->points[k].x, (double)f->points[k].y, point_of(r->map, i, k));
    }
}

static void put_point(sf_writer *w, const sf_reconstruction *r, size_t track, size_t count, double error) {
    const sf_map *map = r->map;
    unsigned rgb[3] = {0};
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        const sf_track_observation *s = &map->tracks.observations[i];
        if (!map->is_used[i] || !map->pictures[s->picture].is_placed) continue;
        for (int c = 0; c < 3; c++) rgb[c] += r->list.photos[s->picture].colors[s->keypoint][c];
    }
    sf_colmap_point point = {.id = track + 1u, .at = map->at[track], .error = error, .observations = count};
    for (int c = 0; c < 3; c++) point.rgb[c] = (uint8_t)((rgb[c] + count / 2) / count);
    sf_colmap_put_point(w, &point);
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        const sf_track_observation *s = &map->tracks.observations[i];
        if (!map->is_used[i] || !map->pictures[s->picture].is_placed) continue;
        sf_colmap_put_observation(w, (uint32_t)s->picture + 1u, (uint32_t)s->keypoint);
    }
}

static void put_points(sf_writer *w, const void *reconstruction) {
    const sf_reconstruction *r = reconstruction;
    sf_reconstruction_info info;
    sf_reconstruction_get_info(r, &info);
    sf_colmap_put_count(w, info.points);
    for (size_t track = 0; track < r->map->tracks.count; track++) {
        double squares = 0;
        size_t count = used(r->map, track, &squares);
        if (count) put_point(w, r, track, count, sqrt(squares / (double)count));
    }
}

sf_status sf_reconstruction_save_colmap(const sf_reconstruction *r, const char *folder) {
    static const sf_colmap_put puts[] = {put_cameras, put_images, put_points};
    return sf_colmap_save(r->ctx, folder, puts, r);
}
