/* around.h - what lies in the folders of a folder: a project's pictures, and what advice names. */
#ifndef SF_IO_AROUND_H
#define SF_IO_AROUND_H

#include <limits.h>

#include "../base/context.h"

/* Where a project has its pictures: the first that exists. */
enum { SF_IMAGE_FOLDERS = 4 };
extern const char *const sf_image_folders[SF_IMAGE_FOLDERS];
/* Logs that it is another one than the first. */
void sf_tell_images(sf_context *ctx, const char *project, const char *name);

/* The name within `top` of a folder that `fits`, one level down, else two: of several the first by name. 0:
 * there is none. */
int sf_find_folder(const char *top, int (*fits)(const char *folder), char name[PATH_MAX]);

/* Whether a folder holds a .jpg, .jpeg or .png. */
int sf_holds_pictures(const char *folder);

#endif
