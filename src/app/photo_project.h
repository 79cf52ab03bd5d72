/* photo_project.h - what the project of photos holds beside their cameras: links to the photos and masks. */
#ifndef APP_PHOTO_PROJECT_H
#define APP_PHOTO_PROJECT_H

#include <splatfit/sfm.h>

#include "app.h"

/* Whether PROJECT/NAME is a link to `folder`, or may become one; where it is another folder, that is said. 0
 * or an exit code. */
int project_check_link(const args *a, const char *project, const char *folder, const char *name);

/* Makes it one. The link is relative where `folder` lies in the project, around it, or in the folder that
 * holds the project: both can be moved together then. 0 or an exit code. */
int project_link(const args *a, const char *project, const char *folder, const char *name);

/* The same of the photos and masks of a project whose cameras were found before: links that lead elsewhere
 * follow photos that were moved, and masks that were added are linked. What is no link is the user's. 0 or an
 * exit code. */
int project_renew_links(const args *a, sf_context *ctx, const char *project, const char *photos);

/* What a project's note says of photos (NULL: only of its cameras). 0 or an exit code. */
int project_compare(const args *a, sf_context *ctx, const char *project, const char *photos,
                    sf_photos_change *change);
int project_note(const args *a, sf_context *ctx, const char *project, const char *photos);

/* Warns where the photos of a project, its images, are not those that its note names. 0 or an exit code. */
int project_tell_change(const args *a, sf_context *ctx, const char *project);

/* Whether cameras may be written to sparse/0: none are there, or those that this program found and noted. 0
 * or an exit code. */
int project_check_cameras(const args *a, sf_context *ctx, const char *project);

/* Renames PROJECT/NAME to NAME.old, or .old2 and so on, and says so. 0 or an exit code. */
int project_keep(const args *a, const char *project, const char *name);

/* Removes a link to masks that this run does not use, and that an earlier one made. */
void project_drop_masks(const char *project, const char *photos);

#endif
