/* dataset.h - a project as its reader fills it in: pictures, their cameras, and points. */
#ifndef SF_IO_DATASET_H
#define SF_IO_DATASET_H

#include "optics.h"
#include "picture.h"

#include <splatfit/scene.h>

/* One picture of a project, not yet read. */
typedef struct sf_entry {
    char *name;        /* the view's: the picture's path inside the folder of the pictures */
    char *path;        /* the picture's */
    char *mask;        /* path of its mask (mask.h); NULL: no mask */
    int width, height; /* px, the size for which the lens is given; the picture's size may differ */
    sf_optics lens;
    double R_cw[9], t_cw[3];
    int border_px;  /* along each side of the picture, of no weight */
    int near_name;  /* the picture's name has another ending or case than the project says */
    int bad_pose;   /* not finite or not a rotation: the view is skipped */
    sf_split split; /* where the project has_split */
} sf_entry;

typedef struct sf_project {
    sf_context *ctx;
    sf_entry *entries;
    size_t count, capacity;
    const char *kind; /* static: what sf_scene_info calls it */
    int has_split;    /* the project itself states which views are held out */
    int blends;       /* the default for alpha is SF_ALPHA_BLEND, not SF_ALPHA_MASK */
    const char *path; /* as the caller named it */
    char *folder;     /* where the project's folders (masks) are */
    double *xyz;      /* [points][3], relative to origin; NAN: not within floats */
    uint8_t *rgb;     /* [points][3] */
    size_t points;
    double origin[3]; /* subtracted from poses and points (origin.h) */
} sf_project;

/* A copy of the name in which '\\' is '/', as Windows writes it, unless the folder holds the name as it is.
 */
char *sf_plain_name(sf_context *ctx, const char *folder, const char *name);

/* Appends an entry, all zero but its name (sf_plain_name; any "./" in front is left out) and its path,
 * folder/name. SF_ERR_FORMAT, naming `file`: the name is empty, absolute or leads out of the folder. */
sf_status sf_project_add(sf_project *project, const char *file, const char *folder, const char *name,
                         sf_entry **entry);

/* The entry's path with the first of the endings (a list that ends with NULL) for which a file exists. If no
 * file exists, the path unchanged, so that a missing file is reported by its name. */
sf_status sf_entry_complete(sf_context *ctx, sf_entry *entry, const char *const *endings);

/* Sorts by name (strcmp). SF_ERR_FORMAT, naming `file`: a name appears twice. */
sf_status sf_project_sort(sf_project *project, const char *file);

/* The entry of that name, in a sorted project; NULL: no such entry. A "./" in front is ignored. */
sf_entry *sf_project_find(const sf_project *project, const char *name);

/* The failure of a load that sf_scene_cancel_loads has ended. */
sf_status sf_load_cancelled(sf_context *ctx, const char *path);

/* Sets project->folder, a copy. */
sf_status sf_project_set_folder(sf_project *project, const char *folder);

/* Frees what the project holds. */
void sf_project_free(sf_project *project);

/* Decides which of the names, sorted by strcmp, are held out: those that options->test_list names, in full or
 * by the part after the last '/'; without a list every n-th. */
sf_status sf_split_names(sf_context *ctx, const sf_load_options *options, size_t count,
                         const char *const *names, sf_split *splits);

/* Whether the files exist by which the kinds of projects are recognised. */
int sf_holds_project(const char *folder);

/* Whether sizes differ by no more than a scale and the rounding of sides to whole pixels. */
int sf_is_same_shape(int width, int height, int of_width, int of_height);

#endif
