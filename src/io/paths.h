/* paths.h - paths of files and folders.
 *
 * Texts are sf_free'd by the caller, and NULL if there is no memory.
 */
#ifndef SF_IO_PATHS_H
#define SF_IO_PATHS_H

#include "../base/context.h"

char *sf_text_copy(sf_context *ctx, const char *text);
/* With one slash between, whatever ends the folder. */
char *sf_path_join(sf_context *ctx, const char *folder, const char *name);
char *sf_path_folder(sf_context *ctx, const char *path);
int sf_is_folder(const char *path);
/* SF_ERR_IO, with what to do, where a folder is a link to what is not there. */
sf_status sf_check_link(sf_context *ctx, const char *folder);
int sf_holds_file(const char *folder, const char *name);
int sf_holds_folder(const char *folder, const char *name);
int sf_is_file(const char *path);
int sf_name_stays_inside(const char *name);
/* The order of file names: runs of digits are compared as numbers, all else by bytes. */
int sf_natural_order(const char *a, const char *b);

#endif
