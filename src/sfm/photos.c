/* photos.c - see photos.h. */
#include "photos.h"

#include <errno.h>
#include <limits.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "../base/pool.h"
#include "../io/dataset.h"
#include "../io/paths.h"
#include "../io/picture.h"
#include "../io/picture_names.h"

#include "photo_folder.h"
#include "photo_masks.h"

#include <splatfit/sfm.h>

static int count_two(void *user, const char *name) {
    (void)name;
    return ++*(int *)user == 2;
}

static int holds_two_photos(const char *folder) {
    int count = 0;
    return sf_photo_folder_walk(folder, count_two, &count) == 1;
}

sf_photos_place sf_sfm_find_photos(const char *folder) {
    char images[PATH_MAX];
    if (!sf_is_folder(folder) || sf_holds_project(folder)) return SF_PHOTOS_NONE;
    int size = snprintf(images, sizeof images, "%s/images", folder);
    if (size > 0 && (size_t)size < sizeof images && holds_two_photos(images)) return SF_PHOTOS_IMAGES;
    return holds_two_photos(folder) ? SF_PHOTOS_HERE : SF_PHOTOS_NONE;
}

typedef struct last_change {
    const char *folder;
    int64_t at;
} last_change;

static void see_change(last_change *c, const char *path) {
    struct stat st;
    if (!stat(path, &st) && (int64_t)st.st_mtime > c->at) c->at = (int64_t)st.st_mtime;
}

/* A folder changes when something in it is added, removed or renamed. */
static int see_photo(void *user, const char *name) {
    last_change *c = user;
    char path[PATH_MAX];
    int size = snprintf(path, sizeof path, "%s/%s", c->folder, name);
    if (size < 0 || (size_t)size >= sizeof path) return 0;
    see_change(c, path);
    *strrchr(path, '/') = 0;
    see_change(c, path);
    return 0;
}

int64_t sf_sfm_photos_changed(const char *folder) {
    last_change c = {.folder = folder};
    sf_photo_folder_walk(folder, see_photo, &c);
    return c.at;
}

static int by_name(const void *a, const void *b) {
    return sf_natural_order(((const sf_photo_file *)a)->name, ((const sf_photo_file *)b)->name);
}

typedef struct listing {
    sf_context *ctx;
    sf_photo_list *list;
    size_t room;
    sf_status status;
} listing;

static int add_photo(void *user, const char *name) {
    listing *l = user;
    sf_photo_list *list = l->list;
    l->status = sf_grow(l->ctx, &list->photos, &l->room, list->count, list->count + 1, sizeof *list->photos);
    if (l->status) return 1;
    list->photos[list->count] = (sf_photo_file){.name = sf_text_copy(l->ctx, name), .factor = 1};
    if (!list->photos[list->count].name) l->status = SF_ERR_MEMORY;
    list->count += !l->status;
    return l->status != SF_OK;
}

/* Pictures of other kinds are not passed over in silence. */
static sf_status tell_unread(sf_context *ctx, const char *path, size_t photos) {
    char ending[SF_ENDING];
    size_t unread = sf_count_unread_pictures(path, ending);
    if (!photos && !unread)
        return sf_fail(ctx, SF_ERR_EMPTY, "%s: holds no photos (.jpg, .jpeg, .png)", path);
    if (!photos)
        return sf_fail(ctx, SF_ERR_EMPTY,
                       "%s: %zu %s files, which are not read: make .jpg or .png of them (ImageMagick, in "
                       "that folder: mogrify -format jpg '*%s')",
                       path, unread, ending, ending);
    if (unread)
        sf_log(ctx, SF_LOG_WARNING, "%s: %zu %s files are left out: .jpg, .jpeg and .png are read", path,
               unread, ending);
    return SF_OK;
}

sf_status sf_photos_list(sf_context *ctx, const char *path, sf_photo_list *list) {
    listing l = {.ctx = ctx, .list = list};
    *list = (sf_photo_list){0};
    if (sf_photo_folder_walk(path, add_photo, &l) < 0)
        return sf_fail(ctx, SF_ERR_IO, "%s: cannot be opened as a folder of photos: %s", path,
                       strerror(errno));
    sf_status status = l.status;
    if (!status) status = tell_unread(ctx, path, list->count);
    if (status) sf_photos_free(ctx, list);
    if (list->count) qsort(list->photos, list->count, sizeof *list->photos, by_name);
    return status;
}

void sf_photos_free(sf_context *ctx, sf_photo_list *list) {
    for (size_t i = 0; i < list->count; i++) {
        sf_features_free(ctx, &list->photos[i].features);
        sf_free(ctx, list->photos[i].colors);
        sf_free(ctx, list->photos[i].name);
    }
    sf_free(ctx, list->photos);
    sf_free(ctx, list->masks);
    *list = (sf_photo_list){0};
}

typedef struct find_job {
    sf_context *ctx;
    const char *folder;
    int side;
    const sf_features_options *options;
    sf_photos_done done;
    void *user;
    sf_photo_list *list;
    atomic_size_t found;
    atomic_int status, cancelled;
} find_job;

/* Rec. 601 luma of the means of factor x factor pixels. */
static void reduce(const sf_picture *from, int factor, uint8_t *to, int width, int height) {
    static const unsigned weights[] = {77, 150, 29};
    size_t plane = (size_t)from->width * (size_t)from->height, n = (size_t)factor;
    for (size_t y = 0; y < (size_t)height; y++)
        for (size_t x = 0; x < (size_t)width; x++) {
            uint64_t sum = 0;
            for (size_t c = 0; c < 3; c++) {
                const uint8_t *at = from->rgb + c * plane + y * n * (size_t)from->width + x * n;
                unsigned of_channel = 0;
                for (size_t j = 0; j < n; j++)
                    for (size_t i = 0; i < n; i++) of_channel += at[j * (size_t)from->width + i];
                sum += (uint64_t)weights[c] * of_channel;
            }
            to[y * (size_t)width + x] = (uint8_t)((sum + 128 * n * n) / (256 * n * n));
        }
}

/* Of a point in the picture reduced by `factor`. */
static void color_at(const sf_picture *picture, const sf_keypoint *point, int factor, uint8_t rgb[3]) {
    size_t width = (size_t)picture->width, height = (size_t)picture->height;
    size_t x = point->x > 0 ? (size_t)(point->x * (float)factor) : 0;
    size_t y = point->y > 0 ? (size_t)(point->y * (float)factor) : 0;
    if (x >= width) x = width - 1;
    if (y >= height) y = height - 1;
    for (size_t c = 0; c < 3; c++) rgb[c] = picture->rgb[(c * height + y) * width + x];
}

static sf_status find_in(const find_job *job, sf_photo_file *photo, const sf_picture *picture) {
    int longer = picture->width > picture->height ? picture->width : picture->height;
    int factor = (longer + job->side - 1) / job->side;
    photo->factor = factor * picture->divided;
    sf_photo grey = {.width = picture->width / factor, .height = picture->height / factor};
    grey.stride = (size_t)grey.width;
    uint8_t *pixels = sf_alloc(job->ctx, grey.stride, (size_t)grey.height);
    if (!pixels) return SF_ERR_MEMORY;
    reduce(picture, factor, pixels, grey.width, grey.height);
    grey.pixels = pixels;
    uint8_t *mask = NULL;
    if (picture->weight) mask = sf_photo_mask_reduce(job->ctx, picture, factor, grey.width, grey.height);
    grey.mask = mask;
    sf_status status = SF_ERR_MEMORY;
    if (mask || !picture->weight) status = sf_features_find(job->ctx, &grey, job->options, &photo->features);
    sf_free(job->ctx, mask);
    sf_free(job->ctx, pixels);
    if (status) return status;
    photo->colors = sf_alloc(job->ctx, photo->features.count + 1, sizeof *photo->colors);
    for (size_t i = 0; photo->colors && i < photo->features.count; i++) {
        sf_keypoint *point = &photo->features.points[i];
        float all = (float)photo->factor;
        color_at(picture, point, factor, photo->colors[i]);
        point->x *= all, point->y *= all, point->scale *= all;
    }
    return photo->colors ? SF_OK : SF_ERR_MEMORY;
}

/* Both cameras and fits take the pixels as they are stored. Turned ones are of another pose; mirrored ones
 * are of no pose at all beside photos that are not. */
static sf_status refuse_mirrored(sf_picture *p) {
    int value = p->orientation;
    if (value != 2 && value != 4 && value != 5 && value != 7) return SF_OK;
    snprintf(p->fault, sizeof p->fault,
             "EXIF orientation: %d says that it is mirrored: store it upright (ImageMagick, in that folder: "
             "mogrify "
             "-auto-orient FILE)",
             value);
    return SF_ERR_UNSUPPORTED;
}

static void find_task(void *job_pointer, size_t task, int thread) {
    find_job *job = job_pointer;
    sf_photo_file *photo = &job->list->photos[task];
    sf_picture picture;
    (void)thread;
    if (atomic_load(&job->status) || atomic_load(&job->cancelled)) return;
    char *path = sf_path_join(job->ctx, job->folder, photo->name);
    sf_status status = path ? sf_picture_load_reduced(job->ctx, path, job->side, &picture) : SF_ERR_MEMORY;
    sf_free(job->ctx, path);
    int is_loaded = !status;
    if (!status) status = refuse_mirrored(&picture);
    if (!status) status = sf_photo_mask_apply(job->ctx, job->list->masks, photo->name, &picture);
    if (status && is_loaded) sf_picture_free(job->ctx, &picture);
    if (!status) {
        photo->width = picture.file_width, photo->height = picture.file_height;
        status = find_in(job, photo, &picture);
        sf_picture_free(job->ctx, &picture);
    } else if (status != SF_ERR_MEMORY) {
        snprintf(photo->fault, sizeof photo->fault, "%s", picture.fault);
        status = SF_OK;
    }
    if (status) atomic_store(&job->status, (int)status);
    size_t found = atomic_fetch_add(&job->found, 1) + 1;
    if (job->done && !thread && job->done(job->user, found)) atomic_store(&job->cancelled, 1);
}

sf_status sf_photos_find_features(sf_context *ctx, const char *folder, int side,
                                  const sf_features_options *options, sf_photos_done done, void *user,
                                  sf_photo_list *list) {
    find_job job = {.ctx = ctx,
                    .folder = folder,
                    .side = side,
                    .options = options,
                    .done = done,
                    .user = user,
                    .list = list};
    sf_pool_run(ctx->pool, list->count, find_task, &job);
    if (atomic_load(&job.status)) return (sf_status)atomic_load(&job.status);
    return atomic_load(&job.cancelled) ? SF_ERR_CANCELLED : SF_OK;
}
