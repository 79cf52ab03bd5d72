/* hd.h - which videos that do not state a matrix of YUV are taken to be in BT.709. */
#ifndef SF_BASE_HD_H
#define SF_BASE_HD_H

enum { SF_HD_WIDTH = 1280, SF_SD_HEIGHT = 576 /* px: the least of HD, the most of standard definition */ };

/* HD and more, by either side, is in BT.709 as a rule: a film of 1280 x 536 is HD cropped to its frame. The
 * rule of mpv and others. What is smaller is in BT.601. */
static inline int sf_is_hd(int width, int height) { return width >= SF_HD_WIDTH || height > SF_SD_HEIGHT; }

#endif
