/* temporary.h - the names under which files are written before they are whole. */
#ifndef SF_BASE_TEMPORARY_H
#define SF_BASE_TEMPORARY_H

#include <stddef.h>
#include <sys/types.h>

/* Bytes that a temporary name takes beyond the path of its target, with the 0. */
enum { SF_TEMPORARY_EXTRA = 64 };

/* Opens a new file beside `path` to write to, under a unique name, [size] bytes with the 0, and locks it.
 * As long as *lock or the file returned is open, others see that its writer lives; the caller closes both.
 * -1: errno says why. */
int sf_temporary_open(const char *path, mode_t mode, char *name, size_t size, int *lock);

/* Removes what writers of `path` that have died since left behind. Who lists the folder pays for all that is
 * in it. */
void sf_temporary_clear(const char *path);

#endif
