/* no_project.h - what to do with a path that holds no cameras: photos, a video, a COLMAP database. */
#ifndef SF_IO_NO_PROJECT_H
#define SF_IO_NO_PROJECT_H

#include <splatfit/context.h>

/* Fails for a folder without a project. The message says what the folder holds and which command to run next:
 * COLMAP's for its database, splatfit's for photos and videos. SF_ERR_IO. */
sf_status sf_no_project_in(sf_context *ctx, const char *folder);

/* The same for a file that is no project. SF_ERR_FORMAT. */
sf_status sf_no_project_file(sf_context *ctx, const char *path);

/* The same for a .zip that holds a video and no pictures, which is not unpacked here. SF_ERR_IO. */
sf_status sf_no_project_of_archive(sf_context *ctx, const char *zip, const char *video);

/* Whether a name ends as those of videos do. */
int sf_is_video_name(const char *name);
/* Whether a file is a video, by its ending or its first bytes. */
int sf_is_video(const char *path);
/* The same of a file that need not be there: its name may be enough. */
int sf_names_video(const char *path);

#endif
