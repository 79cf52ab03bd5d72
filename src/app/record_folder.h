/* record_folder.h - the folder that a recording goes into. */
#ifndef APP_RECORD_FOLDER_H
#define APP_RECORD_FOLDER_H

#include "app.h"

/* Makes the folder, and `images` in it, and sees that both are empty; with `force` the recording there is
 * removed, after all of it is known to be one. source: of the frames, which may come out of a folder. 0, or
 * an exit code after one line on standard error. */
int record_clear_folder(const args *a, const char *folder, const char *images, const char *source, int force);

#endif
