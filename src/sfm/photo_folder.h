/* photo_folder.h - which photos a folder holds. */
#ifndef SF_SFM_PHOTO_FOLDER_H
#define SF_SFM_PHOTO_FOLDER_H

/* Told of each photo by its name within the folder, "left/1.jpg"; what it returns, if not 0, ends the walk.
 */
typedef int (*sf_photo_visit)(void *user, const char *name);

/* The .jpg, .jpeg and .png files of a folder, in no order. Where it has none itself: those of the folders in
 * it, up to four deep, but for hidden ones, those named masks, and projects. Returns what ended the walk, 0:
 * nothing did, and -1: the folder cannot be opened, as errno says. */
int sf_photo_folder_walk(const char *folder, sf_photo_visit visit, void *user);

#endif
