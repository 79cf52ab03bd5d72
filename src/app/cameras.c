/* cameras.c - splatfit cameras: cameras from photos or a video alone, as a COLMAP project. */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "film.h"
#include "photo_project.h"

static const arg_option own_options[] = {
    {"output", 'o', "PROJECT", "the folder to write: sparse/0, and images, a link to the photos"},
    {"frames", 0, "N", "of a video, frames to take at most (100 to 300, by how far its picture moves)"},
    {"features", 0, "N", "features of a photo at most (2048)"},
    {"side", 0, "PX",
     "photos are reduced until no side is longer before features are looked for; so are frames of a video "
     "(1600)"},
    {"all-pairs", 0, "N",
     "of so many photos at most each is matched with each; of more, with those most like it (200)"},
    {"sequence", 0, "N",
     "photos by name are in the order in which they were taken: each is matched with the N next ones alone"},
    {"memory", 0, "BYTES", "most memory of the whole process (900M, 2G); default: 4/5 of what is free"},
    {"focal", 0, "PX", "the focal length of the photos, about; default: told by EXIF, or found"},
    {"lens", 0, "FILE",
     "the calibration of all photos, kept as it is (of splatfit calibrate, OpenCV, COLMAP)"},
    {"masks", 0, "DIR", "folder of masks, in which black is ignored; default: masks in PHOTOS or beside it"},
    {"no-masks", 0, NULL, "ignore all masks"},
    {"progress", 0, "auto|plain|json|none", "auto, plain, json (no lines) or none (auto)"},
    {0},
};

typedef struct job {
    const args *a;
    sf_context *ctx;
    const char *photos, *project;
    int keep; /* rename cameras that were found before, rather than write over them */
    sf_reconstruction *result;
    progress_line line;
    FILE *out;
} job;

static int tell(void *user, sf_sfm_stage stage, size_t done, size_t all) {
    static const char *const names[] = {"features", "pairs matched", "pairs with a geometry",
                                        "photos placed"};
    job *j = user;
    char text[128];
    if (!all || j->line.kind == PROGRESS_JSON) return 0;
    snprintf(text, sizeof text, "%s: %zu of %zu", names[stage], done, all);
    if (progress_due(&j->line, app_seconds(), done == all)) progress_text(&j->line, text);
    return 0; /* a signal ends the program: nothing is written before all cameras are found */
}

static int make_folder(const job *j, const char *path) {
    if (!mkdir(path, 0777) || errno == EEXIST) return 0;
    return app_say(j->a, path, strerror(errno));
}

/* What save would refuse, before minutes of work. */
static int check_project(const job *j, const sf_sfm_options *options) {
    struct stat st;
    if (!stat(j->project, &st) && !S_ISDIR(st.st_mode)) return app_say(j->a, j->project, strerror(ENOTDIR));
    if (sf_sfm_find_photos(j->photos) == SF_PHOTOS_NONE) return 0; /* which says more */
    int error = project_check_link(j->a, j->project, j->photos, "images");
    if (error || !options->masks || options->no_masks) return error;
    return project_check_link(j->a, j->project, options->masks, "masks");
}

static int save(const job *j) {
    char *path = malloc(strlen(j->project) + 16);
    if (!path) return app_say(j->a, j->project, "out of memory");
    int error = make_folder(j, j->project);
    sf_reconstruction_info info;
    sf_reconstruction_get_info(j->result, &info);
    if (!error) error = project_link(j->a, j->project, j->photos, "images");
    if (!error && info.masks) error = project_link(j->a, j->project, info.masks, "masks");
    if (!error && !info.masks) project_drop_masks(j->project, j->photos);
    sprintf(path, "%s/sparse", j->project);
    if (!error) error = make_folder(j, path);
    if (!error && j->keep) error = project_keep(j->a, j->project, "sparse/0");
    sprintf(path, "%s/sparse/0", j->project);
    if (!error) error = make_folder(j, path);
    if (!error && sf_reconstruction_save_colmap(j->result, path)) error = app_fail(j->a, j->ctx);
    if (!error) error = project_note(j->a, j->ctx, j->project, j->photos);
    free(path);
    return error;
}

/* Each camera's lens, at its first photo that is placed. */
static void print_lenses(const job *j, size_t photos) {
    enum { MOST = 8 };
    sf_reconstruction_photo photo;
    size_t cameras = 0;
    char *is_known = calloc(photos, 1); /* by camera, of which there are no more than photos */
    for (size_t i = 0; is_known && i < photos; i++) {
        if (sf_reconstruction_get_photo(j->result, i, &photo) || !photo.placed || is_known[photo.camera])
            continue;
        is_known[photo.camera] = 1;
        if (cameras++ >= MOST) continue;
        fprintf(j->out, "%s%sfocal length %.1f px, k1 %.4f, k2 %.4f", cameras > 1 ? photo.name : "",
                cameras > 1 ? ": " : "", photo.lens.fx, photo.lens.k1, photo.lens.k2);
        if (photo.focal_told > 0) fprintf(j->out, " (EXIF: %.1f px)", photo.focal_told);
        fputc('\n', j->out);
    }
    if (cameras > MOST) fprintf(j->out, "%zu cameras in all\n", cameras);
    free(is_known);
}

static void print_result(const job *j) {
    sf_reconstruction_info info;
    sf_reconstruction_photo photo;
    if (j->line.kind == PROGRESS_JSON || args_value(j->a, "quiet")) return;
    sf_reconstruction_get_info(j->result, &info);
    double seconds = 0;
    for (int s = 0; s < SF_SFM_STAGES; s++) seconds += info.seconds[s];
    for (size_t i = 0; !sf_reconstruction_get_photo(j->result, i, &photo); i++)
        if (!photo.placed) fprintf(j->out, "not placed: %s: %s\n", photo.name, photo.why);
    if (info.other_places)
        fprintf(j->out, "%zu other places, with %zu photos, that nothing connects with this one\n",
                info.other_places, info.other_photos);
    print_lenses(j, info.photos);
    fprintf(j->out,
            "%zu of %zu photos placed, %zu points, %zu observations, reprojection error %.2f px, %.1f s "
            "(features %.1f, matches %.1f, pairs %.1f, mapping %.1f)\n",
            info.placed, info.photos, info.points, info.observations, info.error, seconds, info.seconds[0],
            info.seconds[1], info.seconds[2], info.seconds[3]);
}

/* Finds and writes the cameras. */
static int find(job *j, const sf_sfm_options *options) {
    int error = project_check_cameras(j->a, j->ctx, j->project);
    if (!error) error = check_project(j, options);
    if (error) return error;
    if (sf_sfm_run(j->ctx, j->photos, options, &j->result)) error = app_fail(j->a, j->ctx);
    progress_break(&j->line);
    if (!error) error = save(j);
    if (!error) print_result(j);
    return error;
}

/* The same of a video, whose frames are the project's photos. */
static int find_of_video(job *j, int frames, const sf_sfm_options *options) {
    film_options film = {.frames = frames, .side = options->side, .line = &j->line, .out = j->out};
    const char *video = j->photos;
    char *images = malloc(strlen(j->project) + 16);
    if (!images) return app_say(j->a, video, "out of memory");
    sprintf(images, "%s/images", j->project);
    int error = project_check_cameras(j->a, j->ctx, j->project);
    if (!error) error = film_take(j->a, j->ctx, video, j->project, &film);
    j->photos = images;
    if (!error) error = find(j, options);
    j->photos = video;
    free(images);
    return error;
}

/* The lens and the masks, which the command line may name. */
static int read_inputs(const job *j, sf_sfm_options *options) {
    static sf_calibration known;
    const char *lens = args_value(j->a, "lens");
    options->masks = args_value(j->a, "masks");
    options->no_masks = args_value(j->a, "no-masks") != NULL;
    if (!lens) return 0;
    if (sf_calibration_load(j->ctx, lens, &known)) return app_fail(j->a, j->ctx);
    options->lens = &known.lens;
    options->lens_width = known.width, options->lens_height = known.height;
    return 0;
}

/* --memory, in the words of a fit. */
static int read_memory(const job *j, sf_sfm_options *options) {
    sf_fit_options fit = sf_fit_options_default();
    const char *text = args_value(j->a, "memory");
    if (text && sf_fit_options_set(j->ctx, &fit, "memory", text)) {
        app_fail(j->a, j->ctx);
        return EXIT_USAGE;
    }
    options->memory = text ? fit.memory : 0;
    return 0;
}

static int read_options(const job *j, sf_sfm_options *options) {
    *options = sf_sfm_options_default();
    int error = args_int(j->a, "side", 64, 28000, &options->side);
    if (!error) error = args_int(j->a, "features", 100, 1000000, &options->features);
    if (!error) error = args_int(j->a, "all-pairs", 0, 1000000, &options->all_pairs);
    if (!error) error = args_int(j->a, "sequence", 1, 1000000, &options->sequence);
    if (!error) error = args_numbers(j->a, "focal", 1, &options->focal);
    if (!error) error = read_inputs(j, options);
    options->progress = tell;
    options->user = (void *)(uintptr_t)j;
    return error;
}

/* Cameras that were found before must have the lens that is wanted now. */
static int check_lens(const job *j) {
    sf_sfm_options options = sf_sfm_options_default();
    sf_calibration before;
    char path[PATH_MAX];
    int error = read_inputs(j, &options);
    if (error || !options.lens) return error;
    snprintf(path, sizeof path, "%s/sparse/0/cameras.bin", j->project);
    if (!sf_calibration_load(j->ctx, path, &before) &&
        !memcmp(&before.lens, options.lens, sizeof before.lens))
        return 0;
    return app_say(j->a, j->project,
                   "its cameras were found with another lens: remove it, or name no --lens");
}

/* Where the photos of `path` are, and their project. 0 or an exit code. */
static int name_folders(job *j, const char *path, int is_video, char **photos, char **project) {
    int own = !is_video && sf_sfm_find_photos(path) == SF_PHOTOS_IMAGES;
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    *photos = malloc(length + 16);
    *project = is_video ? film_project(path) : malloc(length + 16);
    if (!*photos || !*project) return app_say(j->a, path, "out of memory");
    sprintf(*photos, "%.*s%s", (int)length, path, own ? "/images" : "");
    if (!is_video) sprintf(*project, "%.*s%s", (int)length, path, own ? "" : ".project");
    j->photos = *photos, j->project = *project;
    return 0;
}

/* Whether a project has cameras; st: of the file that holds them. */
static int has_cameras(const char *project, struct stat *st) {
    char known[PATH_MAX];
    snprintf(known, sizeof known, "%s/sparse/0/images.bin", project);
    return !stat(known, st);
}

int app_cameras_were_found(const args *a, const char *path, char **project) {
    job j = {.a = a};
    struct stat st;
    char *photos = NULL;
    int error = name_folders(&j, path, sf_film_is(path), &photos, project);
    free(photos);
    return !error && has_cameras(*project, &st);
}

/* Of cameras without a note of their photos, and those that somebody changed: the user decides what holds. */
static void tell_found(const job *j, const char *path, int is_video, time_t found) {
    struct stat st = {0};
    int64_t changed = is_video ? 0 : sf_sfm_photos_changed(j->photos);
    if (is_video && !stat(path, &st)) changed = (int64_t)st.st_mtime;
    if (args_value(j->a, "quiet")) return;
    fprintf(stderr, "cameras of %s, found before: %s\n", path, j->project);
    if (changed > (int64_t)found)
        fprintf(stderr,
                "warning: %s was changed after they were found, and what was added has no camera: "
                "remove %s to find them anew\n",
                path, j->project);
}

static int is_change(const sf_photos_change *c) { return c->added || c->removed || c->replaced; }

/* Whether photos, or a video, are not those whose cameras were found; a run that is continued or repeated has
 * the cameras of then. What is said of it goes before the search. 0 or an exit code. */
static int look_for_change(const job *j, const char *path, int is_video, int *changed) {
    sf_photos_change photos = {0}, video = {0};
    *changed = 0;
    if (args_value(j->a, "resume") || args_value(j->a, "replay")) return 0;
    int error = is_video ? film_compare(j->a, j->ctx, path, j->project, &video) : 0;
    char *images = malloc(strlen(j->project) + 16);
    if (!images) return app_say(j->a, path, "out of memory");
    sprintf(images, "%s/images", j->project);
    if (!error) error = project_compare(j->a, j->ctx, j->project, is_video ? images : j->photos, &photos);
    free(images);
    *changed = !error && !photos.other_cameras && photos.noted && (is_change(&photos) || is_change(&video));
    if (!*changed || args_value(j->a, "quiet")) return error;
    if (is_change(&video))
        fprintf(stderr, "%s was changed after its cameras were found: they are found again\n", path);
    else
        fprintf(stderr,
                "%s: photos were changed after their cameras were found (%zu added, %zu removed, %zu "
                "replaced): they are found again\n",
                is_video ? j->project : path, photos.added, photos.removed, photos.replaced);
    return 0;
}

static int find_with_defaults(job *j, int is_video) {
    sf_sfm_options options = sf_sfm_options_default();
    options.progress = tell, options.user = j;
    int error = progress_start(&j->line, j->a, j->out);
    if (!error) error = read_inputs(j, &options);
    if (!error) error = read_memory(j, &options);
    if (error) return error;
    return is_video ? find_of_video(j, 0, &options) : find(j, &options);
}

int app_find_cameras(const args *a, sf_context *ctx, const char *path, FILE *out, char **project) {
    job j = {.a = a, .ctx = ctx, .out = out};
    struct stat st;
    char *photos = NULL;
    int is_video = sf_film_is(path), changed = 0;
    int error = name_folders(&j, path, is_video, &photos, project);
    int found = !error && has_cameras(*project, &st);
    if (found) error = look_for_change(&j, path, is_video, &changed);
    j.keep = changed;
    found = found && !changed;
    if (!error && !found) error = find_with_defaults(&j, is_video);
    if (!error && found) error = check_lens(&j);
    if (!error && found && !is_video) error = project_renew_links(a, ctx, *project, photos);
    if (!error && found) tell_found(&j, path, is_video, st.st_mtime);
    sf_reconstruction_destroy(&j.result);
    free(photos);
    return error;
}

/* The folder of photos in what was named: also in a project's folder, whose cameras are found anew. NULL: no
 * memory. */
static char *photos_in(const char *path) {
    char *images = malloc(strlen(path) + 16);
    if (!images) return NULL;
    sprintf(images, "%s/images", path);
    int is_own = sf_sfm_find_photos(path) != SF_PHOTOS_HERE && sf_sfm_find_photos(images) == SF_PHOTOS_HERE;
    if (!is_own) strcpy(images, path);
    return images;
}

static int find_as_told(job *j) {
    sf_sfm_options options;
    int frames = 0, error = app_context(j->a, &j->ctx);
    if (!error) error = read_options(j, &options);
    if (!error) error = args_int(j->a, "frames", 2, 5000, &frames);
    if (!error) error = read_memory(j, &options);
    if (!error) error = progress_start(&j->line, j->a, j->out);
    if (!error && frames && !sf_film_is(j->photos))
        error = app_say(j->a, "--frames", "is for videos: of photos, all are taken");
    if (!error) error = sf_film_is(j->photos) ? find_of_video(j, frames, &options) : find(j, &options);
    sf_reconstruction_destroy(&j->result);
    sf_context_destroy(&j->ctx);
    return error;
}

static int run(const args *a) {
    if (!args_value(a, "output")) {
        app_say(a, "an argument is missing", "-o PROJECT");
        return EXIT_USAGE;
    }
    char *photos = photos_in(a->positional[0]);
    job j = {.a = a, .photos = photos, .project = args_value(a, "output"), .out = stdout};
    int error = photos ? find_as_told(&j) : app_say(a, a->positional[0], "out of memory");
    free(photos);
    return error;
}

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_cameras = {
    .name = "cameras",
    .synopsis = "PHOTOS|VIDEO -o PROJECT [OPTIONS]",
    .summary = "Finds the cameras of photos of one place, by structure from motion, and writes them with "
               "sparse points as a COLMAP project, which fit reads. Of a video, sharp and evenly spaced "
               "frames become the project's photos; ffmpeg reads it.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .run = run,
};
