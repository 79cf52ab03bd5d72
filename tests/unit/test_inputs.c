/* test_inputs.c - the projects that users have, one of each kind: a table of what must load, and how.
 * src/io/README.md has the same list.
 *
 * All show the same scene from the same three cameras: only how that is written down differs.
 */
#include "inputs_fixture.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Of 0 and 1, and of a label's number. */
static void make_label_masks(const char *project, const char *rest) {
    inputs_make_colmap(project, rest);
    inputs_put_mask_of(project, "masks/a.png", 1, 1);
    inputs_put_mask_of(project, "masks/b.png", 1, 1);
    inputs_put_mask_of(project, "masks/c.png", 1, 17);
}

static void make_one_black_mask(const char *project, const char *rest) {
    (void)rest;
    inputs_make_black_masks(project, 1);
}

static void make_small_masks(const char *project, const char *rest) {
    inputs_make_colmap(project, rest);
    inputs_put_mask(project, "masks/a.png.png", 2);
    inputs_put_mask(project, "masks/c.png", 1);
}

static void make_grey(const char *p, const char *rest) { inputs_make_kind(p, GREY, rest); }
static void make_deep(const char *p, const char *rest) { inputs_make_kind(p, DEEP, rest); }
static void make_palette(const char *p, const char *rest) { inputs_make_kind(p, PALETTE, rest); }
static void make_interlaced(const char *p, const char *rest) { inputs_make_kind(p, INTERLACED, rest); }
static void make_alpha(const char *p, const char *rest) { inputs_make_kind(p, ALPHA, rest); }
static void make_jpeg(const char *p, const char *rest) { inputs_make_kind(p, JPEG, rest); }
static void make_progressive(const char *p, const char *rest) { inputs_make_kind(p, PROGRESSIVE, rest); }
static void make_grey_jpeg(const char *p, const char *rest) { inputs_make_kind(p, GREY_JPEG, rest); }
static void make_turned(const char *p, const char *rest) { inputs_make_kind(p, TURNED_JPEG, rest); }

static const char ply[] = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                          "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                          "end_header\n1 2 3 10 20 30\n-1 0 2 40 50 60\n";

static void make_nerfstudio(const char *project, const char *more) {
    char head[600];
    snprintf(head, sizeof head,
             "{'camera_model':'OPENCV','orientation_override':'none','ply_file_path':'sparse_pc.ply',"
             "'applied_transform':[[1,0,0,0],[0,0,1,0],[0,-1,0,0]],'applied_scale':0.5,%s",
             more);
    inputs_put_pictures(project, "images", ".png", RGB);
    inputs_put_text(project, "sparse_pc.ply", ply);
    inputs_put_transforms(project, "transforms.json", 0, VIEWS, head,
                          "'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.5,'w':24,'h':16,'k1':-0.05,'p1':0.001,"
                          "'file_path':'images/%s.png','depth_file_path':'depth/%s.png','colmap_im_id':1,");
}

static void make_marked_ngp(const char *project, const char *more) {
    inputs_marked = 1;
    inputs_make_ngp(project, more);
    inputs_marked = 0;
}

static void make_mask_path(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, "images", ".png", RGB);
    for (int v = 0; v < VIEWS; v++) {
        char name[64];
        snprintf(name, sizeof name, "m/%s-mask.png", inputs_names[v]);
        inputs_put_mask(project, name, 1);
    }
    inputs_put_transforms(project, "transforms.json", 0, VIEWS, inputs_intrinsics,
                          "'file_path':'images/%s.png','mask_path':'m/%s-mask.png',");
}

static void make_transforms_alpha(const char *project, const char *rest) {
    (void)rest;
    inputs_put_pictures(project, "images", ".png", ALPHA);
    inputs_put_transforms(project, "transforms.json", 0, VIEWS, inputs_intrinsics,
                          "'file_path':'images/%s',");
}

/* camera_angle_x of fx = 20 at a width of 24; the principal point is the middle. */
static void make_blender(const char *project, const char *held_out) {
    static const char head[] = "{'camera_angle_x':1.0808390005411683,";
    inputs_put_png(project, "test/a.png", 0, 1, ALPHA);
    inputs_put_png(project, "train/b.png", 1, 1, ALPHA);
    inputs_put_png(project, "train/c.png", 2, 1, ALPHA);
    inputs_put_transforms(project, "transforms_train.json", 1, 3, head,
                          "'file_path':'./train/%s','rotation':0.01,");
    inputs_put_transforms(project, held_out, 0, 1, head, "'file_path':'./test/%s','rotation':0.01,");
    if (strcmp(held_out, "transforms_val.json") != 0)
        inputs_put_text(project, "transforms_val.json", "not read");
}

/* fx and fy in the longer side, 24; the principal point from the middle. */
#define NORMALISED                                                                                           \
    "'focal_x':0.83333333333333337,'focal_y':0.875,'c_x':0.020833333333333332,'c_y':0.020833333333333332,"

static void make_marked_opensfm(const char *project, const char *camera) {
    inputs_marked = 1;
    inputs_make_opensfm(project, camera);
    inputs_marked = 0;
}

static void make_odm(const char *project, const char *camera) {
    inputs_put_pictures(project, "images", ".JPG", JPEG);
    inputs_put_opensfm(project, "opensfm/reconstruction.json", camera, 0, VIEWS, "%s.JPG");
}

static void make_undistorted(const char *project, const char *camera) {
    inputs_put_pictures(project, "images", ".JPG.jpg", JPEG);
    inputs_put_opensfm(project, "reconstruction.json", camera, 0, VIEWS, "%s.JPG");
}

static void pack(archive *a, const char *folder, const char *front) {
    struct dirent **entries;
    int n = scandir(folder, &entries, NULL, alphasort);
    assert_true(n >= 0);
    for (int i = 0; i < n; i++) {
        char path[1024], name[1024];
        struct stat st;
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        snprintf(name, sizeof name, "%s%s", front, entries[i]->d_name);
        if (*entries[i]->d_name != '.' && !stat(path, &st)) {
            if (S_ISDIR(st.st_mode)) {
                strcat(name, "/");
                pack(a, path, name);
            } else {
                size_t size;
                uint8_t *data = test_read(path, &size);
                inputs_add_entry(a, name, data, size, size, 0, 0100644);
                free(data);
            }
        }
        free(entries[i]);
    }
    free(entries);
}

/* project.zip, of the project in a folder `front`. */
static void zip_project(const char *project, const char *front) {
    static archive a;
    char name[256];
    memset(&a, 0, sizeof a);
    inputs_add_entry(&a, "__MACOSX/._odd", (const uint8_t *)"odd", 3, 3, 0, 0100644);
    if (!strcmp(front, "beside/")) inputs_add_entry(&a, "notes.txt", (const uint8_t *)"n", 1, 1, 0, 0100644);
    pack(&a, test_path(project), front);
    snprintf(name, sizeof name, "%s.zip", project);
    inputs_put_archive(&a, name);
}

static void zip_colmap(const char *project, const char *front) {
    inputs_make_colmap(project, inputs_pinhole);
    zip_project(project, front);
}

static void zip_ngp(const char *project, const char *front) {
    inputs_make_ngp(project, "");
    zip_project(project, front);
}

static void zip_blender(const char *project, const char *front) {
    make_blender(project, "transforms_test.json");
    zip_project(project, front);
}

static void zip_opensfm(const char *project, const char *front) {
    inputs_make_opensfm(project,
                        "'projection_type':'brown'," NORMALISED "'k1':0,'k2':0,'k3':0,'p1':0,'p2':0");
    zip_project(project, front);
}

typedef struct fixture {
    const char *name;
    void (*make)(const char *project, const char *how);
    const char *how;
    const char *open; /* behind the project's path */
    /* options */
    const char *images, *masks;
    int sub_model; /* + 1 */
    int no_masks, hold_out_none;
    sf_alpha alpha;
    float background;
    /* what must come out */
    const char *kind, *lens, *log;
    int divisor;                              /* of the pictures' sides; 0: 1 */
    int views, tests;                         /* 0: 3 and 1; -1: none */
    int missing, masked, alphas, undistorted; /* -1: all */
    int rotated, cropped;
    int hidden; /* (PX, PY) of view a does not count */
    int color;  /* 0: the scene's; 1: black, 2: white, 3: its red as grey, 4: as a JPEG */
    int middle; /* the principal point is the middle, fy is fx */
    int no_points;
    int wide; /* a fisheye, whose pinhole picture is larger */
} fixture;

#define C .kind = "COLMAP"
#define T .kind = "transforms.json"
#define B .kind = "Blender", .no_points = 1, .middle = 1, .alphas = 3
#define O .kind = "OpenSfM", .log = "of 2 reconstructions, 1 is taken"

static const fixture fixtures[] = {
    {"simple_pinhole", inputs_make_colmap, "SIMPLE_PINHOLE 24 16 20 12.5 8.5", C, .lens = "SIMPLE_PINHOLE",
     .middle = 2},
    {"pinhole", inputs_make_colmap, inputs_pinhole, C, .lens = "PINHOLE"},
    {"simple_radial", inputs_make_colmap, "SIMPLE_RADIAL 24 16 20 12.5 8.5 -0.05", C, .lens = "SIMPLE_RADIAL",
     .middle = 2, .undistorted = 3},
    {"radial", inputs_make_colmap, "RADIAL 24 16 20 12.5 8.5 -0.05 0.01", C, .lens = "RADIAL", .middle = 2,
     .undistorted = 3},
    {"opencv", inputs_make_colmap, "OPENCV 24 16 20 21 12.5 8.5 -0.05 0.01 0.001 -0.002", C, .lens = "OPENCV",
     .undistorted = 3},
    {"opencv_fisheye", inputs_make_colmap, "OPENCV_FISHEYE 24 16 20 21 12.5 8.5 0.01 0.01 0.001 0.001", C,
     .lens = "OPENCV_FISHEYE", .wide = 1, .undistorted = 3},
    {"wide_fisheye", inputs_make_colmap, "OPENCV_FISHEYE 24 16 7.6394372684109761 8 12.5 8.5 0 0 0 0", C,
     .lens = "OPENCV_FISHEYE", .wide = 1, .undistorted = 3, .cropped = 3, .middle = 3,
     .log = "of the 180 degrees across"},
    {"full_opencv", inputs_make_colmap,
     "FULL_OPENCV 24 16 20 21 12.5 8.5 0.1 0.01 0.001 -0.002 0.001 0.2 0.02 0.001", C, .lens = "FULL_OPENCV",
     .undistorted = 3},
    {"fov", inputs_make_colmap, "FOV 24 16 20 21 12.5 8.5 1.1", C, .lens = "FOV", .wide = 1,
     .undistorted = 3},
    {"simple_radial_fisheye", inputs_make_colmap, "SIMPLE_RADIAL_FISHEYE 24 16 20 12.5 8.5 0.02", C,
     .lens = "SIMPLE_RADIAL_FISHEYE", .middle = 2, .wide = 1, .undistorted = 3},
    {"radial_fisheye", inputs_make_colmap, "RADIAL_FISHEYE 24 16 20 12.5 8.5 0.02 0.01", C,
     .lens = "RADIAL_FISHEYE", .middle = 2, .wide = 1, .undistorted = 3},
    {"thin_prism_fisheye", inputs_make_colmap,
     "THIN_PRISM_FISHEYE 24 16 20 21 12.5 8.5 0.02 0.01 0.001 -0.001 0.001 0.001 0.002 -0.002", C,
     .lens = "THIN_PRISM_FISHEYE", .wide = 1, .undistorted = 3},
    {"fisheye", inputs_make_colmap, "FISHEYE 24 16 20 21 12.5 8.5", C, .lens = "FISHEYE", .wide = 1,
     .undistorted = 3},
    {"simple_fisheye", inputs_make_colmap, "SIMPLE_FISHEYE 24 16 20 12.5 8.5", C, .lens = "SIMPLE_FISHEYE",
     .middle = 2, .wide = 1, .undistorted = 3},
    {"unused_camera", inputs_make_colmap, "PINHOLE 24 16 20 21 12.5 8.5\n9 EUCM 24 16 20 21 12.5 8.5 0.5 1",
     C, .lens = "PINHOLE"},
    {"binary_rigs", inputs_make_binary, "", C, .lens = "PINHOLE"},
    {"sparse_flat", inputs_make_flat, "sparse/", C},
    {"root", inputs_make_flat, "", C},
    {"beside", inputs_make_beside, "", C},
    {"backslashes", inputs_make_backslashes, "", C},
    {"marked_colmap", inputs_make_marked_colmap, inputs_pinhole, C, .lens = "PINHOLE"},
    {"images_4", inputs_make_small, "images_4", C, .divisor = 2,
     .log = "the pictures of images_4/ are taken"},
    {"other_size", inputs_make_small, "images", C, .divisor = 2},
    {"named_images", inputs_make_small, "photos", C, .images = "photos", .divisor = 2},
    {"sub_models", inputs_make_several, "", C, .log = "of 2 models, 1 is taken: it has most images, 3"},
    {"sub_model_0", inputs_make_several, "", C, .sub_model = 1, .views = 1, .tests = -1, .hold_out_none = 1},
    {"model_itself", inputs_make_colmap, inputs_pinhole, .open = "/sparse/0", C},
    {"sub folders", inputs_make_subfolders, "", C},
    {"missing", inputs_make_missing, inputs_pinhole, C, .views = 2, .missing = 1, .log = "c.png: skipped: "},
    {"masks_long", inputs_make_masked, "masks/%s.png.png", C, .masked = 3, .hidden = 1},
    {"masks_stem", inputs_make_masked, "masks/%s.png", C, .masked = 3, .hidden = 1,
     .log = "masks of 3 of 3 pictures"},
    {"masks_named", inputs_make_masked, "my masks/%s.png", .masks = "my masks", C, .masked = 3, .hidden = 1},
    {"masks_metashape", inputs_make_masked, "masks/%s_mask.jpg", C, .masked = 3, .hidden = 1},
    {"masks_realityscan", inputs_make_masked, "masks/%s.png.mask.png", C, .masked = 3, .hidden = 1},
    {"masks_jpeg", inputs_make_masked, "masks/%s.jpg", C, .masked = 3, .hidden = 1},
    {"masks_labels", make_label_masks, inputs_pinhole, C, .masked = 3, .hidden = 1},
    {"masks_of_others", inputs_make_masked, "masks/%s-other.png", C,
     .log = "masks: no mask fits a picture: looked for a.png.png, a.png, a_mask.png and .jpg"},
    {"masks_unused", inputs_make_masked, "other/%s.png", C},
    {"masks_refused", inputs_make_masked, "masks/%s.png", .no_masks = 1, C},
    {"masks_some", make_small_masks, inputs_pinhole, C, .masked = 2, .hidden = 1,
     .log = "masks of 2 of 3 pictures"},
    {"masks_one_black", make_one_black_mask, inputs_pinhole, C, .masked = 3, .hidden = 1,
     .log = "1 of 3 pictures have no pixel that counts: a mask or transparency hides all (first: "},
    {"grey", make_grey, ".png", C, .color = 3},
    {"deep", make_deep, ".png", C},
    {"palette", make_palette, ".png", C},
    {"interlaced", make_interlaced, ".png", C},
    {"png_alpha", make_alpha, ".png", C, .alphas = 3, .hidden = 1, .log = "what is transparent is ignored"},
    {"alpha_ignored", make_alpha, ".png", .alpha = SF_ALPHA_IGNORE, C, .alphas = 3},
    {"jpeg", make_jpeg, ".jpg", C, .color = 4},
    {"jpeg_progressive", make_progressive, ".jpeg", C, .color = 4},
    {"jpeg_grey", make_grey_jpeg, ".JPG", C, .color = 3},
    {"jpeg_exif", make_turned, ".jpg", C, .color = 4, .rotated = 3,
     .log = "3 pictures carry an EXIF orientation"},
    {"ngp", inputs_make_ngp, "'k1':0,'k2':0,", T, .lens = "PINHOLE", .no_points = 1},
    {"ngp_distorted", inputs_make_ngp, "'k1':-0.05,'k2':0.01,'k3':0.002,'p1':0.001,'p2':0,", T,
     .lens = "OPENCV", .undistorted = 3, .no_points = 1},
    {"ngp_fisheye", inputs_make_ngp, "'is_fisheye':true,'k1':0.01,'k4':0.001,", T, .lens = "OPENCV_FISHEYE",
     .wide = 1, .undistorted = 3, .no_points = 1},
    {"marked_ngp", make_marked_ngp, "", T, .no_points = 1},
    {"ngp_file", inputs_make_ngp, "", .open = "/transforms.json", T, .no_points = 1},
    {"ngp_images_2", inputs_make_ngp, "", .images = "images_2", T, .divisor = 2, .no_points = 1},
    {"nerfstudio", make_nerfstudio, "", T, .lens = "OPENCV", .undistorted = 3},
    {"nerfstudio_split", make_nerfstudio,
     "'train_filenames':['images/b.png'],'val_filenames':['images/a.png'],'test_filenames':['images/c.png'],",
     T, .undistorted = 3, .tests = 2},
    {"nerfstudio_masks", make_mask_path, "", T, .masked = 3, .hidden = 1, .no_points = 1},
    {"nerfstudio_no_masks", make_mask_path, "", .no_masks = 1, T, .no_points = 1},
    {"transforms_alpha", make_transforms_alpha, "", T, .alphas = 3, .hidden = 1, .no_points = 1},
    {"blender", make_blender, "transforms_test.json", B, .color = 1, .log = "blended over the background"},
    {"blender_white", make_blender, "transforms_test.json", .background = 1, B, .color = 2},
    {"blender_mask", make_blender, "transforms_test.json", .alpha = SF_ALPHA_MASK, B, .hidden = 1},
    {"blender_val", make_blender, "transforms_val.json", B, .color = 1},
    {"opensfm", inputs_make_opensfm, "'projection_type':'perspective'," NORMALISED "'k1':-0.05,'k2':0.01", O,
     .lens = "perspective", .undistorted = 3},
    {"opensfm_old", inputs_make_opensfm,
     "'projection_type':'perspective','focal':0.83333333333333337,'k1':0,'k2':0", O, .lens = "perspective",
     .middle = 1},
    {"opensfm_brown", inputs_make_opensfm,
     "'projection_type':'brown'," NORMALISED "'k1':-0.05,'k2':0.01,'k3':0.001,'p1':0.001,'p2':-0.001", O,
     .lens = "brown", .undistorted = 3},
    {"opensfm_simple", inputs_make_opensfm, "'projection_type':'simple_radial'," NORMALISED "'k1':-0.05", O,
     .lens = "simple_radial", .undistorted = 3},
    {"opensfm_radial", inputs_make_opensfm, "'projection_type':'radial'," NORMALISED "'k1':-0.05,'k2':0.02",
     O, .lens = "radial", .undistorted = 3},
    {"opensfm_fisheye", inputs_make_opensfm,
     "'projection_type':'fisheye','focal':0.83333333333333337,'k1':0,'k2':0", O, .lens = "fisheye",
     .middle = 1, .wide = 1, .undistorted = 3, .color = 4},
    {"opensfm_fisheye_opencv", inputs_make_opensfm,
     "'projection_type':'fisheye_opencv'," NORMALISED "'k1':0.01,'k2':0,'k3':0,'k4':0.001", O,
     .lens = "fisheye_opencv", .wide = 1, .undistorted = 3},
    {"marked_opensfm", make_marked_opensfm, NORMALISED "'k1':0", .open = "/reconstruction.json", O},
    {"opensfm_file", inputs_make_opensfm, NORMALISED "'k1':0", .open = "/reconstruction.json", O},
    {"opensfm_drones", make_odm, "'projection_type':'brown'," NORMALISED "'k1':0", O, .color = 4},
    {"opensfm_undistorted", make_undistorted, "'projection_type':'perspective'," NORMALISED "'k1':0", O,
     .color = 4},
#ifdef SF_HAVE_LIBZIP
    {"zip_colmap", zip_colmap, "", .open = ".zip", C},
    {"zip_folders", zip_ngp, "data/my scene/", .open = ".zip", T, .no_points = 1},
    {"zip_beside", zip_ngp, "beside/", .open = ".zip", T, .no_points = 1}, /* a file beside its folder */
    {"zip_blender", zip_blender, "lego/", .open = ".zip", B, .color = 1},
    {"zip_opensfm", zip_opensfm, "", .open = ".zip", O},
#endif
};

enum { FIXTURES = sizeof fixtures / sizeof *fixtures };

static sf_load_options options_of(const fixture *f) {
    sf_load_options options = sf_load_options_default();
    options.images = f->images;
    options.masks = f->masks;
    options.no_masks = f->no_masks;
    options.alpha = f->alpha;
    for (int c = 0; c < 3; c++) options.background[c] = f->background;
    if (f->sub_model) options.sub_model = f->sub_model - 1;
    if (f->hold_out_none) options.hold_out = 0;
    return options;
}

static const char *where;

static void same(const char *what, double got, double expected, double tolerance) {
    if (!(fabs(got - expected) <= tolerance))
        fail_msg("%s: %s: %.12g is not %.12g", where, what, got, expected);
}

static void check_counts(const fixture *f, const sf_scene_info *info) {
    if (!info->kind || strcmp(info->kind, f->kind) != 0) fail_msg("%s: kind: %s", where, info->kind);
    int views = f->views ? f->views : VIEWS, tests = f->tests ? f->tests : 1;
    same("views", (double)info->views, views, 0);
    same("held out", (double)info->test_views, tests < 0 ? 0 : tests, 0);
    same("points", (double)info->points, f->no_points ? 0 : 2, 0);
    same("missing", (double)info->skipped_missing, f->missing, 0);
    same("poses", (double)info->skipped_pose, 0, 0);
    same("masked", (double)info->masked_views, f->masked, 0);
    same("alpha", (double)info->alpha_views, f->alphas, 0);
    same("undistorted", (double)info->undistorted_views, f->undistorted, 0);
    same("cropped", (double)info->cropped_views, f->cropped, 0);
    same("rotated", (double)info->rotated_views, f->rotated, 0);
}

static void check_camera(const fixture *f, const sf_view_info *view, int number) {
    const sf_camera *c = &view->camera;
    double R[9], divisor = f->divisor ? f->divisor : 1, x = inputs_fx, y = f->middle ? inputs_fx : inputs_fy;
    if (f->middle == 3) { /* the wide one */
        x = 24 / 3.14159265358979323846;
        y = 8;
    }
    inputs_rotation_of(number, R);
    double x0 = (f->middle == 1 ? 12 : inputs_cx) / divisor, y0 = (f->middle == 1 ? 8 : inputs_cy) / divisor;
    double left = f->wide ? round(c->cx - x0) : 0, top = f->wide ? round(c->cy - y0) : 0;
    if (f->wide && !(c->width > WIDTH && c->height >= HEIGHT && left > 0 && top >= 0))
        fail_msg("%s: size: %d x %d", where, c->width, c->height);
    if (!f->wide) same("width", c->width, WIDTH / divisor, 0);
    if (!f->wide) same("height", c->height, HEIGHT / divisor, 0);
    same("fx", c->fx, x / divisor, 1e-9);
    same("fy", c->fy, y / divisor, 1e-9);
    same("cx", c->cx, x0 + left, 1e-9);
    same("cy", c->cy, y0 + top, 1e-9);
    for (int i = 0; i < 9; i++) same("rotation", c->R_cw[i], R[i], 1e-9);
    for (int i = 0; i < 3; i++) same("translation", c->t_cw[i], inputs_translations[number][i], 1e-9);
    if (f->lens && (!view->lens || strcmp(view->lens, f->lens) != 0))
        fail_msg("%s: lens: %s", where, view->lens);
}

static void check_pixel(sf_context *ctx, const fixture *f, sf_scene *scene, const sf_view_info *view,
                        int number) {
    static float rgb[3 * 4 * WIDTH * HEIGHT], weight[4 * WIDTH * HEIGHT];
    const sf_camera *camera = &view->camera;
    int at = (int)camera->cy * camera->width + (int)camera->cx; /* the principal point's, (PX, PY) */
    assert_true(camera->width * camera->height <= 4 * WIDTH * HEIGHT);
    assert_ok(ctx, sf_scene_get_pixels(scene, view->id, rgb, weight));
    same("weight", (double)weight[at], !f->hidden, 1e-6);
    if (f->hidden) return;
    for (int c = 0; c < 3; c++) {
        double expected = f->color == 1   ? 0
                          : f->color == 2 ? 255
                                          : inputs_shade(number, PX, PY, f->color == 3 ? 0 : c);
        same("colour", 255 * (double)rgb[3 * at + c], expected, f->color >= 3 ? 2 : 0.01);
    }
}

static void check_points(sf_scene *scene) {
    float xyz[6];
    uint8_t rgb[6];
    const float expected[] = {1, 2, 3, -1, 0, 2};
    const uint8_t colors[] = {10, 20, 30, 40, 50, 60};
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, rgb), 2);
    assert_memory_equal(xyz, expected, sizeof xyz);
    assert_memory_equal(rgb, colors, sizeof rgb);
}

/* From the headers of its files alone a project has the same views. */
static void check_headers(sf_context *ctx, const fixture *f, const char *path, sf_scene *whole) {
    sf_scene *scene;
    sf_scene_info info;
    sf_view_info view, other;
    sf_memory_bill bill = {0};
    sf_load_options options = options_of(f);
    options.no_pixels = 1;
    if (sf_scene_load(ctx, path, &options, &scene)) fail_msg("%s: %s", where, sf_last_error(ctx));
    sf_scene_get_info(scene, &info);
    check_counts(f, &info);
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        check_camera(f, &view, f->sub_model ? 1 : (int)i);
        assert_ok(ctx, sf_scene_get_view(whole, i, &other));
        same("mask", view.has_mask, other.has_mask, 0);
    }
    sf_fitter *fitter;
    uint64_t fingerprint;
    assert_status(ctx, sf_scene_get_pixels(scene, 1, NULL, NULL), SF_ERR_ARGUMENT);
    test_assert_contains(sf_last_error(ctx), "not read", __FILE__, __LINE__);
    assert_status(ctx, sf_scene_fingerprint(scene, &fingerprint), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_fitter_create(ctx, scene, NULL, NULL, &fitter), SF_ERR_ARGUMENT);
    assert_ok(ctx, sf_fit_memory(ctx, scene, NULL, &bill));
    assert_true(bill.total > bill.before && bill.before > 0);
    assert_ok(ctx, sf_scene_set_pose(scene, 1, view.camera.R_cw, view.camera.t_cw));
    sf_scene_destroy(&scene);
}

static void check_fixture(sf_context *ctx, const fixture *f) {
    char path[512];
    sf_scene *scene;
    sf_scene_info info;
    sf_view_info view = {0};
    sf_load_options options = options_of(f);
    where = f->name;
    f->make(f->name, f->how);
    snprintf(path, sizeof path, "%s%s", test_path(f->name), f->open ? f->open : "");
    test_log_clear();
    if (sf_scene_load(ctx, path, &options, &scene)) fail_msg("%s: %s", where, sf_last_error(ctx));
    sf_scene_get_info(scene, &info);
    check_counts(f, &info);
    if (f->log && !strstr(test_log, f->log))
        fail_msg("%s: the log lacks \"%s\": %s", where, f->log, test_log);
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        int number = f->sub_model ? 1 : (int)i;
        check_camera(f, &view, number);
        if (i == 0) check_pixel(ctx, f, scene, &view, number);
    }
    if (!f->no_points) check_points(scene);
    check_headers(ctx, f, path, scene);
    sf_scene_destroy(&scene);
}

static void test_fixtures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_true(FIXTURES >= 60);
    for (size_t i = 0; i < FIXTURES; i++) check_fixture(ctx, &fixtures[i]);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fixtures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
