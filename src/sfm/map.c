/* map.c - the memory of a map. */
#include "map.h"

#include <string.h>

sf_map_options sf_map_options_default(void) {
    return (sf_map_options){
        .error_px = 4, .least_angle = 0.0262, .least_seen = 15, .first_count = 60, .radial = 2, .seed = 1};
}

/* Copies of the caller's pictures, with room for their tracks. */
static int copy_pictures(sf_map *map, const sf_map_input *input) {
    map->pictures = sf_calloc(map->ctx, input->picture_count + 1, sizeof *map->pictures);
    if (!map->pictures) return 0;
    for (size_t i = 0; i < input->picture_count; i++) {
        const sf_map_picture *from = &input->pictures[i];
        sf_map_picture *to = &map->pictures[map->picture_count++];
        *to = (sf_map_picture){.keypoints = from->keypoints,
                               .count = from->count,
                               .camera = from->camera,
                               .is_left_out = from->is_left_out};
        to->track_of = sf_alloc(map->ctx, from->count + 1, sizeof *to->track_of);
        if (!to->track_of) return 0;
        memset(to->track_of, 0xff, (from->count + 1) * sizeof *to->track_of);
    }
    return 1;
}

static sf_status make_tracks(sf_map *map, const sf_map_input *input) {
    size_t *counts = sf_alloc(map->ctx, map->picture_count + 1, sizeof *counts);
    if (!counts) return SF_ERR_MEMORY;
    for (size_t i = 0; i < map->picture_count; i++) counts[i] = map->pictures[i].count;
    sf_status status =
        sf_tracks_make(map->ctx, input->pairs, input->pair_count, counts, map->picture_count, &map->tracks);
    for (size_t track = 0; track < map->tracks.count; track++)
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
            const sf_track_observation *s = &map->tracks.observations[i];
            map->pictures[s->picture].track_of[s->keypoint] = (uint32_t)track;
        }
    sf_free(map->ctx, counts);
    return status;
}

static sf_status fill(sf_map *map, const sf_map_input *input) {
    map->cameras = sf_alloc(map->ctx, input->camera_count + 1, sizeof *map->cameras);
    if (!map->cameras || !copy_pictures(map, input)) return SF_ERR_MEMORY;
    map->camera_count = input->camera_count;
    sf_status status = make_tracks(map, input);
    if (status) return status;
    size_t tracks = map->tracks.count, observations = map->tracks.first[tracks];
    map->at = sf_alloc(map->ctx, tracks + 1, sizeof *map->at);
    map->has_point = sf_alloc(map->ctx, tracks + 1, 1);
    map->is_used = sf_alloc(map->ctx, observations + 1, 1);
    if (!map->at || !map->has_point || !map->is_used) return SF_ERR_MEMORY;
    sf_map_clear(map, input);
    return SF_OK;
}

sf_status sf_map_create(sf_context *ctx, const sf_map_input *input, const sf_map_options *options,
                        sf_map **map) {
    *map = sf_calloc(ctx, 1, sizeof **map);
    if (!*map) return SF_ERR_MEMORY;
    (*map)->ctx = ctx;
    (*map)->options = *options;
    sf_status status = fill(*map, input);
    if (status) sf_map_destroy(map);
    return status;
}

void sf_map_clear(sf_map *map, const sf_map_input *input) {
    memcpy(map->cameras, input->cameras, map->camera_count * sizeof *map->cameras);
    for (size_t i = 0; i < map->camera_count; i++) map->cameras[i].radial = map->options.radial;
    for (size_t i = 0; i < map->picture_count; i++)
        map->pictures[i].is_placed = 0, map->pictures[i].tried_at = 0;
    memset(map->has_point, 0, map->tracks.count);
    memset(map->is_used, 0, map->tracks.first[map->tracks.count]);
    map->placed_count = 0;
    map->spread = 0;
}

void sf_map_destroy(sf_map **pointer) {
    sf_map *map = *pointer;
    if (!map) return;
    for (size_t i = 0; i < map->picture_count; i++) sf_free(map->ctx, map->pictures[i].track_of);
    sf_tracks_free(map->ctx, &map->tracks);
    void *const blocks[] = {map->cameras, map->pictures, map->at, map->has_point, map->is_used};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(map->ctx, blocks[i]);
    sf_free(map->ctx, map);
    *pointer = NULL;
}
