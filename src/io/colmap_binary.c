/* colmap_binary.c - see colmap_binary.h. */
#include "colmap_binary.h"

#include <string.h>

/* The number of records, checked against the bytes that each takes at least. */
static sf_status read_count(sf_colmap_reader *r, sf_bytes *b, const char *what, size_t least_bytes,
                            uint64_t *count) {
    *count = sf_bytes_u64(b);
    if (b->failed) return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: ends before the number of %ss", r->file, what);
    if (*count > sf_bytes_left(b) / least_bytes)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: number of %ss: %llu are more than its %llu bytes hold",
                       r->file, what, (unsigned long long)*count, (unsigned long long)b->size);
    return SF_OK;
}

static sf_status cut_off(sf_colmap_reader *r, const char *what, uint64_t index, uint64_t count) {
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: ends within %s %llu of %llu", r->file, what,
                   (unsigned long long)index + 1, (unsigned long long)count);
}

static sf_status check_end(sf_colmap_reader *r, const sf_bytes *b, const char *what, uint64_t count) {
    if (!sf_bytes_left(b)) return SF_OK;
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: %llu bytes follow the last of %llu %ss", r->file,
                   (unsigned long long)sf_bytes_left(b), (unsigned long long)count, what);
}

static sf_status read_camera(sf_colmap_reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    sf_colmap_camera_record record = {.id = sf_bytes_u32(b)};
    uint32_t model = sf_bytes_u32(b);
    if (b->failed) return cut_off(r, "camera", index, count);
    record.model = sf_lens_model_at(model);
    if (!record.model)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu: model: number %ld is not known", r->file,
                       (unsigned long)record.id, (long)(int32_t)model);
    record.width = sf_bytes_u64(b);
    record.height = sf_bytes_u64(b);
    if (record.model->layout)
        for (size_t i = 0; record.model->layout[i]; i++) record.parameters[i] = sf_bytes_f64(b);
    else
        sf_bytes_take(b, 8 * (size_t)record.model->unread);
    return b->failed ? cut_off(r, "camera", index, count) : sf_colmap_add_camera(r, &record);
}

sf_status sf_colmap_read_cameras(sf_colmap_reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "camera", 4 + 4 + 8 + 8 + 2 * 8, &count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_camera(r, b, i, count);
    return status ? status : check_end(r, b, "camera", count);
}

static sf_status read_image(sf_colmap_reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    sf_colmap_image_record record = {.id = sf_bytes_u32(b)};
    for (int i = 0; i < 4; i++) record.q[i] = sf_bytes_f64(b);
    for (int i = 0; i < 3; i++) record.t[i] = sf_bytes_f64(b);
    record.camera = sf_bytes_u32(b);
    if (b->failed) return cut_off(r, "image", index, count);
    record.name = (const char *)b->data + b->at;
    const void *end = memchr(record.name, 0, sf_bytes_left(b));
    if (!end)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu: name: has no end", r->file,
                       (unsigned long)record.id);
    sf_bytes_take(b, (size_t)((const char *)end - record.name) + 1);
    uint64_t observations = sf_bytes_u64(b);
    if (b->failed) return cut_off(r, "image", index, count);
    if (observations > sf_bytes_left(b) / 24)
        return sf_fail(r->ctx, SF_ERR_FORMAT,
                       "%s: image %lu: number of points: %llu are more than the file holds", r->file,
                       (unsigned long)record.id, (unsigned long long)observations);
    sf_bytes_take(b, (size_t)observations * 24);
    return sf_colmap_add_image(r, &record);
}

sf_status sf_colmap_read_images(sf_colmap_reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "image", 4 + 7 * 8 + 4 + 1 + 8, &count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_image(r, b, i, count);
    return status ? status : check_end(r, b, "image", count);
}

static sf_status read_point(sf_colmap_reader *r, sf_bytes *b, uint64_t index, uint64_t count) {
    sf_colmap_point_record record;
    uint64_t id = sf_bytes_u64(b);
    for (int i = 0; i < 3; i++) record.xyz[i] = sf_bytes_f64(b);
    for (int i = 0; i < 3; i++) record.rgb[i] = sf_bytes_u8(b);
    sf_bytes_f64(b); /* error */
    uint64_t track = sf_bytes_u64(b);
    if (b->failed) return cut_off(r, "point", index, count);
    if (track > sf_bytes_left(b) / 8)
        return sf_fail(r->ctx, SF_ERR_FORMAT,
                       "%s: point %llu: track: %llu images are more than the file holds", r->file,
                       (unsigned long long)id, (unsigned long long)track);
    sf_bytes_take(b, (size_t)track * 8);
    return sf_colmap_add_point(r, &record);
}

sf_status sf_colmap_read_points(sf_colmap_reader *r, sf_bytes *b) {
    uint64_t count;
    sf_status status = read_count(r, b, "point", 8 + 3 * 8 + 3 + 8 + 8, &count);
    if (!status) status = sf_colmap_make_room_for_points(r, (size_t)count);
    for (uint64_t i = 0; !status && i < count; i++) status = read_point(r, b, i, count);
    return status ? status : check_end(r, b, "point", count);
}
