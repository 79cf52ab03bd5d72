/* around.h - what lies in the folders of a folder, for advice. */
#ifndef SF_IO_AROUND_H
#define SF_IO_AROUND_H

#include <limits.h>

/* The name within `top` of a folder that `fits`, one level down, else two: of several the first by name. 0:
 * there is none. */
int sf_find_folder(const char *top, int (*fits)(const char *folder), char name[PATH_MAX]);

/* Whether a folder holds a .jpg, .jpeg or .png. */
int sf_holds_pictures(const char *folder);

#endif
