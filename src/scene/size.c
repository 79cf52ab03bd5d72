/* size.c - centre and size of a scene, by medians: single cameras and points far from all others do not
 * count. What the scene holds (sf_scene_get_info). */
#include "scene.h"

#include <math.h>

#include "../base/statistics.h"
#include "neighbours.h"

/* Cameras and points that medians are taken of, evenly chosen. */
enum { CAMERAS = 256, POINTS = 4096, VIEWS = 32, SEEN_POINTS = 1024, LEAST_SEEN = 8 };

/* A camera is far from all others at FAR times the median distance from the median centre. */
#define FAR 5.0
/* A point is, at this many times the median distance of points from there: matches with hardly any parallax.
 * A landscape's horizon is nearer. */
#define FAR_POINT 100.0

typedef struct camera_list {
    const sf_camera *at[CAMERAS];
    size_t n;
} camera_list;

static size_t even(size_t k, size_t n, size_t of) { return (size_t)((double)k * (double)of / (double)n); }

static double distance(const double *a, const double *b) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

/* The training cameras, at most `most` of them. */
static void list_cameras(const sf_scene *scene, size_t train_views, size_t most, camera_list *list) {
    size_t n = train_views < most ? train_views : most, seen = 0;
    list->n = 0;
    for (size_t i = 0; i < scene->view_count && list->n < n; i++) {
        if (scene->views[i]->split != SF_SPLIT_TRAIN) continue;
        if (seen++ == even(list->n, n, train_views)) list->at[list->n++] = &scene->views[i]->camera;
    }
}

static size_t count_training(const sf_scene *scene) {
    size_t count = 0;
    for (size_t i = 0; i < scene->view_count; i++) count += scene->views[i]->split == SF_SPLIT_TRAIN;
    return count;
}

/* The median distance of the training cameras from their median centre; median: that centre. */
static double typical_distance(const sf_scene *scene, size_t train_views, double median[3]) {
    camera_list list;
    double values[CAMERAS], c[3];
    list_cameras(scene, train_views, CAMERAS, &list);
    for (int k = 0; k < 3; k++) {
        for (size_t i = 0; i < list.n; i++) {
            sf_camera_center(list.at[i], c);
            values[i] = c[k];
        }
        median[k] = sf_median(values, list.n);
    }
    for (size_t i = 0; i < list.n; i++) {
        sf_camera_center(list.at[i], c);
        values[i] = distance(c, median);
    }
    return sf_median(values, list.n);
}

/* The largest distance from the median centre at which a camera counts; median: that centre. */
static double reach_of(const sf_scene *scene, size_t train_views, double median[3]) {
    double typical = typical_distance(scene, train_views, median);
    return typical > 0 ? FAR * typical : INFINITY;
}

/* Whether a view's camera is of the training, and not far from all others. */
static int counts(const sf_view *view, const double median[3], double reach, double c[3]) {
    sf_camera_center(&view->camera, c);
    return view->split == SF_SPLIT_TRAIN && distance(c, median) <= reach;
}

/* The largest distance of a training camera from the mean of all, without those far from all others; 0 where
 * all are in one place, up to rounding. center: that mean. */
static double camera_spread(const sf_scene *scene, double center[3]) {
    double median[3], c[3], largest = 0, reach = reach_of(scene, count_training(scene), median), near = 0;
    center[0] = center[1] = center[2] = 0;
    for (size_t i = 0; i < scene->view_count; i++) near += counts(scene->views[i], median, reach, c);
    for (size_t i = 0; i < scene->view_count; i++)
        for (int k = 0; counts(scene->views[i], median, reach, c) && k < 3; k++) center[k] += c[k] / near;
    for (size_t i = 0; i < scene->view_count; i++)
        if (counts(scene->views[i], median, reach, c)) largest = fmax(largest, distance(c, center));
    /* cameras in one place differ by rounding */
    double scale = fabs(center[0]) + fabs(center[1]) + fabs(center[2]);
    return 1.1 * largest > 1e-9 * scale ? largest : 0;
}

/* The depths of the points in a camera's picture, out of SEEN_POINTS; returns how many those are. */
static size_t seen_depths(const sf_scene *scene, const sf_camera *camera, double depths[SEEN_POINTS]) {
    size_t most = scene->point_count < SEEN_POINTS ? scene->point_count : SEEN_POINTS, n = 0;
    for (size_t k = 0; k < most; k++) {
        const float *p = scene->points + 3 * even(k, most, scene->point_count);
        double u, v, at[3] = {(double)p[0], (double)p[1], (double)p[2]};
        n += (size_t)sf_camera_sees(camera, at, &u, &v, &depths[n]);
    }
    return n;
}

/* Their median; 0 where there are few. */
static double median_depth(const sf_scene *scene, const sf_camera *camera) {
    double depths[SEEN_POINTS];
    size_t n = seen_depths(scene, camera, depths);
    return n < LEAST_SEEN ? 0 : sf_median(depths, n);
}

/* The median over the training views of the median depth of what they see; 0 where the points do not tell. */
static double typical_depth(const sf_scene *scene, size_t train_views) {
    camera_list list;
    double depths[VIEWS];
    size_t n = 0;
    list_cameras(scene, train_views, VIEWS, &list);
    for (size_t i = 0; i < list.n; i++) {
        depths[n] = median_depth(scene, list.at[i]);
        n += depths[n] > 0;
    }
    return 2 * n >= list.n && n ? sf_median(depths, n) : 0;
}

/* The median distance of the points from `center`; 0 without points. */
static double median_distance(const sf_scene *scene, const double center[3]) {
    double distances[POINTS];
    size_t n = scene->point_count < POINTS ? scene->point_count : POINTS;
    for (size_t k = 0; k < n; k++) {
        const float *p = scene->points + 3 * even(k, n, scene->point_count);
        double at[3] = {(double)p[0], (double)p[1], (double)p[2]};
        distances[k] = distance(at, center);
    }
    return sf_median(distances, n);
}

/* Sets info->center and info->extent. */
static void measure_size(const sf_scene *scene, sf_scene_info *info) {
    double spread = camera_spread(scene, info->center);
    info->extent = typical_depth(scene, info->train_views);
    if (!(info->extent > 0)) info->extent = 1.1 * spread;
    if (!(info->extent > 0)) info->extent = median_distance(scene, info->center);
    if (!(info->extent > 0)) info->extent = 1;
}

static size_t list_far(const sf_scene *scene, int split, sf_far_view *list, size_t most) {
    double median[3], c[3], depths[SEEN_POINTS],
        typical = typical_distance(scene, count_training(scene), median);
    size_t n = 0;
    for (size_t i = 0; i < scene->view_count && typical > 0; i++) {
        const sf_view *view = scene->views[i];
        sf_camera_center(&view->camera, c);
        double times = distance(c, median) / typical;
        if ((split >= 0 && (int)view->split != split) || times < FAR) continue;
        if (n < most)
            list[n] = (sf_far_view){view->id, view->name, times, seen_depths(scene, &view->camera, depths)};
        n++;
    }
    return n;
}

size_t sf_scene_far_views(sf_scene *scene, int split, sf_far_view *list, size_t most) {
    pthread_mutex_lock(&scene->lock);
    size_t n = list_far(scene, split, list, most);
    pthread_mutex_unlock(&scene->lock);
    return n;
}

size_t sf_scene_count_far_points(sf_scene *scene) {
    double median[3];
    size_t count = 0;
    pthread_mutex_lock(&scene->lock);
    (void)typical_distance(scene, count_training(scene), median);
    double reach = FAR_POINT * median_distance(scene, median);
    for (size_t i = 0; i < scene->point_count && reach > 0; i++) {
        const float *p = scene->points + 3 * i;
        double at[3] = {(double)p[0], (double)p[1], (double)p[2]};
        count += distance(at, median) > reach;
    }
    pthread_mutex_unlock(&scene->lock);
    return count;
}

int sf_scene_in_one_place(sf_scene *scene) {
    double center[3];
    pthread_mutex_lock(&scene->lock);
    int result = count_training(scene) && !(camera_spread(scene, center) > 0);
    pthread_mutex_unlock(&scene->lock);
    return result;
}

void sf_scene_get_info(sf_scene *scene, sf_scene_info *info) {
    pthread_mutex_lock(&scene->lock);
    *info = (sf_scene_info){
        .views = scene->view_count,
        .points = scene->point_count,
        .skipped_missing = scene->skipped_missing,
        .skipped_pose = scene->skipped_pose,
        .skipped_points = scene->skipped_points,
        .undistorted_views = scene->undistorted_views,
        .rotated_views = scene->rotated_views,
        .kind = scene->kind,
    };
    for (size_t i = 0; i < scene->view_count; i++) {
        const sf_view *v = scene->views[i];
        info->masked_views += (size_t)v->masked;
        info->alpha_views += (size_t)v->alpha;
        info->cropped_views += (size_t)sf_lens_is_cropped(&v->lens);
    }
    info->train_views = count_training(scene);
    info->test_views = info->views - info->train_views;
    measure_size(scene, info);
    pthread_mutex_unlock(&scene->lock);
}
