/* sfm.h - structure from motion: cameras and sparse points from photos alone. */
#ifndef SPLATFIT_SFM_H
#define SPLATFIT_SFM_H

#include <stddef.h>
#include <stdint.h>

#include "calibrate.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where a folder holds photos without cameras. */
typedef enum sf_photos_place {
    SF_PHOTOS_NONE,  /* it is a project, holds fewer than two photos, or is no folder */
    SF_PHOTOS_HERE,  /* in the folder itself */
    SF_PHOTOS_IMAGES /* in its folder images */
} sf_photos_place;

/* Looks for photos (.jpg, .jpeg, .png) in a folder and in its folder images; where one holds none itself, in
 * the folders in it, up to four deep, but for hidden ones, those named masks, and projects. */
SF_API sf_photos_place sf_sfm_find_photos(const char *folder);
/* When a photo of a folder was last written, added or removed, in seconds since 1970; 0: it holds none. */
SF_API int64_t sf_sfm_photos_changed(const char *folder);

/* How photos compare with a note of them. */
typedef struct sf_photos_change {
    int noted;                       /* whether there is a note; 0: all else is 0, too */
    size_t added, removed, replaced; /* photos since then */
    int other_cameras;               /* whether the files of the cameras are not those of then */
} sf_photos_change;

/* Writes a note, of text, of what cameras were found of: the photos of a folder, or a video; and of the
 * files of those cameras (cameras.bin, images.bin, points3D.bin) in the folder `cameras`. Of each file it has
 * the size and a hash of both ends. Either may be NULL: is not noted. SF_ERR_IO, SF_ERR_MEMORY. */
SF_API sf_status sf_sfm_note_photos(sf_context *context, const char *photos, const char *cameras,
                                    const char *note);
/* Compares what is there now with a note of then; `photos` and `cameras` NULL where they were in the note.
 * SF_ERR_IO: a note that cannot be read, SF_ERR_MEMORY. */
SF_API sf_status sf_sfm_compare_photos(sf_context *context, const char *photos, const char *cameras,
                                       const char *note, sf_photos_change *change);
/* The folder of the masks of photos, as sf_sfm_run finds it where none is named: masks in the photos' folder
 * or beside it, with a mask of a photo; "": there is none. SF_ERR_ARGUMENT: `size` is too small for it;
 * SF_ERR_IO, SF_ERR_EMPTY: there are no photos; SF_ERR_MEMORY. */
SF_API sf_status sf_sfm_find_masks(sf_context *context, const char *photos, char *masks, size_t size);

/* The cameras of a folder of photos. */
typedef struct sf_reconstruction sf_reconstruction;

/* The stages, in their order. */
typedef enum sf_sfm_stage {
    SF_SFM_FEATURES, /* of photos */
    SF_SFM_MATCHES,  /* of pairs of photos */
    SF_SFM_GEOMETRY, /* of pairs of photos */
    SF_SFM_MAPPING,  /* of photos that are placed */
    SF_SFM_STAGES    /* how many stages there are */
} sf_sfm_stage;

/* Told as a stage goes on: so many of all are done; all 0: not known yet. What it returns, if not 0, cancels.
 */
typedef int (*sf_sfm_progress)(void *user, sf_sfm_stage stage, size_t done, size_t all);

/* How cameras are found. Start from sf_sfm_options_default(). */
typedef struct sf_sfm_options {
    int side;       /* px: photos are reduced until no side is longer, 64..28000 */
    int features;   /* of a photo at most, 100..1000000 */
    int all_pairs;  /* of so many photos at most each is matched with each, 0..1000000; of more, with
                       those that are most like it and with its neighbours by name */
    int sequence;   /* photos by name are in the order in which they were taken: each is matched with so many
                       next ones alone, 1..1000000; 0: they are in any order */
    int64_t memory; /* bytes for the whole process: refuse photos that take more; 0: 4/5 of what is free */
    double error;   /* px of the photo as it was reduced: the greatest distance of an inlier from where its
                       point is seen, above 0 */
    double focal;   /* px of the photos, about; 0: found */
    const sf_lens *lens;             /* the lens of all photos, kept as it is; NULL: found */
    int32_t lens_width, lens_height; /* px: of the photos that it is for; 0: photos of one size */
    const char *masks; /* the folder of the photos' masks; NULL: masks in the photos' folder or beside it */
    int no_masks;      /* use none */
    sf_sfm_progress progress; /* NULL: none */
    void *user;               /* for progress */
} sf_sfm_options;

/* Sides of 1,600 px, 2,048 features, all pairs of 200 photos, 4 px, the lens found. */
SF_API sf_sfm_options sf_sfm_options_default(void);

/* Finds the cameras of the photos in a folder (.jpg, .jpeg, .png): features, matches of pairs, their
 * geometry, and a map that grows photo by photo. Photos of one make, model, focal length and size share a
 * lens, as far as their EXIF tells (in a build with libexif), upright or on their side; where it tells
 * neither make nor model, those of one folder do. The focal length that it tells is where the search begins,
 * and the pictures can overrule it. Nothing is found where masks are black and photos transparent. The same
 * bytes for any number of threads. options NULL: the defaults. SF_ERR_IO; SF_ERR_EMPTY: fewer than two
 * photos, or no pair that can begin a map (sf_last_error says why); SF_ERR_ARGUMENT: an option out of its
 * range, a photo that has not the lens's size; SF_ERR_CANCELLED; SF_ERR_MEMORY, also where options->memory is
 * too little. On failure *reconstruction is NULL. */
SF_API sf_status sf_sfm_run(sf_context *context, const char *folder, const sf_sfm_options *options,
                            sf_reconstruction **reconstruction);

/* Sets *reconstruction to NULL; NULL is allowed. */
SF_API void sf_reconstruction_destroy(sf_reconstruction **reconstruction);

/* What was found. */
typedef struct sf_reconstruction_info {
    size_t photos, placed;       /* in the folder; with a pose */
    size_t points, observations; /* sparse points, and where photos see them */
    double error;                /* px: root mean square distance between points and where photos see them */
    double seconds[SF_SFM_STAGES]; /* that each stage took */
    const char *masks; /* the folder of the masks that were used; NULL: none; as long as the reconstruction */
    size_t other_places, other_photos; /* maps of places that nothing connects with this one; their photos */
} sf_reconstruction_info;

/* Sums up the reconstruction. */
SF_API void sf_reconstruction_get_info(const sf_reconstruction *reconstruction, sf_reconstruction_info *info);

/* A photo of the folder. */
typedef struct sf_reconstruction_photo {
    const char *name;              /* within the folder; as long as the reconstruction */
    int placed;                    /* whether it has a pose */
    const char *why;               /* why it has none; "": it has one */
    size_t features, observations; /* found in it; of them, those that are seen points */
    int32_t width, height;         /* px; 0: it cannot be read */
    size_t camera;           /* that took it: photos with the same one share focal length and distortion */
    double focal_told;       /* px: the focal length that the photo's EXIF tells; 0: none */
    sf_lens lens;            /* as found, or as given */
    double R_cw[9], t_cw[3]; /* as of sf_camera, in an arbitrary frame and unit */
} sf_reconstruction_photo;

/* Photo 0 .. photos-1, by name, numbers in it by value. SF_ERR_ARGUMENT: there is none of that index. */
SF_API sf_status sf_reconstruction_get_photo(const sf_reconstruction *reconstruction, size_t index,
                                             sf_reconstruction_photo *photo);

/* Writes cameras.bin, images.bin and points3D.bin, as COLMAP reads them, into a folder that exists.
 * SF_ERR_IO, SF_ERR_MEMORY. */
SF_API sf_status sf_reconstruction_save_colmap(const sf_reconstruction *reconstruction, const char *folder);

/* Frames of a video, taken as photos. */

/* Whether a file is a video: by its ending (.mp4, .mov, .mkv, .webm, .avi and others), or its first bytes. */
SF_API int sf_film_is(const char *path);

/* The two readings of a video. */
typedef enum sf_film_stage {
    SF_FILM_LOOK, /* all frames, to judge them */
    SF_FILM_TAKE  /* those that are taken */
} sf_film_stage;

/* Told as frames are read: so many of about all; all 0: not known. What it returns, if not 0, cancels. */
typedef int (*sf_film_progress)(void *user, sf_film_stage stage, size_t done, size_t all);

/* How frames are taken. Start from sf_film_options_default(). */
typedef struct sf_film_options {
    int frames;                /* at most, 2..5000; 0: 100 to 300, by how far the picture moves */
    int side;                  /* px: frames are reduced until no side is longer, 64..28000 */
    int quality;               /* of the JPEGs, 1..100 */
    sf_film_progress progress; /* NULL: none */
    void *user;                /* for progress */
} sf_film_options;

/* frames 0, sides of 1,600 px, quality 95. */
SF_API sf_film_options sf_film_options_default(void);

/* What was taken of a video. */
typedef struct sf_film_info {
    size_t frames, taken;  /* in the video; as photos */
    int32_t width, height; /* px, of the photos */
    double path;           /* how far the picture moved, in its longer side */
} sf_film_info;

/* Writes sharp frames of a video, evenly spaced along the way of its picture, as frame_000000.jpg and so on
 * (the number of the frame in the video) into `folder`, which must not exist; it is there only when all
 * frames are. ffmpeg, as a program, reads the video, turns its frames as it says, and reduces them. options
 * NULL: the defaults. info may be NULL. SF_ERR_IO: no such file, no ffmpeg, or the folder cannot be written;
 * SF_ERR_FORMAT: no video, or a damaged one; SF_ERR_EMPTY: too few frames, or a picture that does not move;
 * SF_ERR_ARGUMENT: an option out of its range; SF_ERR_CANCELLED; SF_ERR_MEMORY. */
SF_API sf_status sf_film_take_frames(sf_context *context, const char *video, const char *folder,
                                     const sf_film_options *options, sf_film_info *info);

#ifdef __cplusplus
}
#endif
#endif
