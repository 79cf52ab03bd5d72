/* colmap_records.c - see colmap_records.h. */
#include "colmap_records.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

sf_status sf_colmap_unsupported(sf_colmap_reader *r, const sf_colmap_camera *c) {
    int panorama = !strcmp(c->lens.model, "EQUIRECTANGULAR"); /* no pinhole camera shows all of it */
    return sf_fail(r->ctx, SF_ERR_UNSUPPORTED, "%s: camera %lu: model %s is not supported%s", r->file,
                   (unsigned long)c->id, c->lens.model,
                   panorama ? "" : "; colmap image_undistorter makes a PINHOLE of it");
}

static sf_status check_side(sf_colmap_reader *r, uint32_t id, const char *side, uint64_t value) {
    if (value >= 1 && value <= SF_PICTURE_MAX_SIDE) return SF_OK;
    return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu: %s: %llu is not in 1..%d", r->file,
                   (unsigned long)id, side, (unsigned long long)value, SF_PICTURE_MAX_SIDE);
}

sf_status sf_colmap_add_camera(sf_colmap_reader *r, const sf_colmap_camera_record *record) {
    sf_status status = check_side(r, record->id, "width", record->width);
    if (!status) status = check_side(r, record->id, "height", record->height);
    if (!status)
        status = sf_grow(r->ctx, &r->cameras, &r->camera_capacity, r->camera_count, r->camera_count + 1,
                         sizeof *r->cameras);
    if (!status)
        r->cameras[r->camera_count++] = (sf_colmap_camera){record->id, (int)record->width,
                                                           (int)record->height, record->model->layout != NULL,
                                                           sf_optics_make(record->model, record->parameters)};
    return status;
}

static int by_id(const void *a, const void *b) {
    uint32_t x = ((const sf_colmap_camera *)a)->id, y = ((const sf_colmap_camera *)b)->id;
    return (x > y) - (x < y);
}

sf_status sf_colmap_sort_cameras(sf_colmap_reader *r) {
    if (!r->camera_count) return SF_OK;
    qsort(r->cameras, r->camera_count, sizeof *r->cameras, by_id);
    for (size_t i = 1; i < r->camera_count; i++)
        if (r->cameras[i].id == r->cameras[i - 1].id)
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: camera %lu appears twice", r->file,
                           (unsigned long)r->cameras[i].id);
    return SF_OK;
}

/* 0 if the quaternion (w, x, y, z) has no direction. */
static int rotation(const double quat[4], double R[9]) {
    double norm = sqrt(quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3]);
    if (!isfinite(norm) || norm < 1e-12) return 0;
    sf_rotation_from_quat(quat, R);
    return 1;
}

sf_status sf_colmap_add_image(sf_colmap_reader *r, const sf_colmap_image_record *record) {
    const sf_colmap_camera *c = NULL;
    if (r->camera_count)
        c = bsearch(&(sf_colmap_camera){.id = record->camera}, r->cameras, r->camera_count, sizeof *c, by_id);
    if (!c)
        return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu: camera %lu does not exist", r->file,
                       (unsigned long)record->id, (unsigned long)record->camera);
    if (!c->supported) return sf_colmap_unsupported(r, c);
    sf_status status = sf_grow(r->ctx, &r->image_ids, &r->image_capacity, r->image_count, r->image_count + 1,
                               sizeof *r->image_ids);
    sf_entry *e;
    if (!status) status = sf_project_add(r->project, r->file, r->pictures, record->name, &e);
    if (status) return status;
    r->image_ids[r->image_count++] = record->id;
    e->width = c->width;
    e->height = c->height;
    e->lens = c->lens;
    e->bad_pose = !rotation(record->q, e->R_cw) || !isfinite(record->t[0]) || !isfinite(record->t[1]) ||
                  !isfinite(record->t[2]);
    memcpy(e->t_cw, record->t, sizeof e->t_cw);
    return SF_OK;
}

static int by_value(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

sf_status sf_colmap_check_image_ids(sf_colmap_reader *r) {
    if (!r->image_count) return SF_OK;
    qsort(r->image_ids, r->image_count, sizeof *r->image_ids, by_value);
    for (size_t i = 1; i < r->image_count; i++)
        if (r->image_ids[i] == r->image_ids[i - 1])
            return sf_fail(r->ctx, SF_ERR_FORMAT, "%s: image %lu appears twice", r->file,
                           (unsigned long)r->image_ids[i]);
    return SF_OK;
}

sf_status sf_colmap_make_room_for_points(sf_colmap_reader *r, size_t more) {
    sf_project *p = r->project;
    sf_status status =
        sf_grow(r->ctx, &p->xyz, &r->xyz_capacity, p->points, p->points + more, 3 * sizeof *p->xyz);
    return status ? status : sf_grow(r->ctx, &p->rgb, &r->rgb_capacity, p->points, p->points + more, 3);
}

sf_status sf_colmap_add_point(sf_colmap_reader *r, const sf_colmap_point_record *record) {
    sf_status status = sf_colmap_make_room_for_points(r, 1);
    if (status) return status;
    size_t at = 3 * r->project->points++;
    for (size_t k = 0; k < 3; k++) {
        r->project->xyz[at + k] = record->xyz[k];
        r->project->rgb[at + k] = record->rgb[k];
    }
    return SF_OK;
}
