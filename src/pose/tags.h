/* tags.h - all that is asked of libapriltag. */
#ifndef SF_POSE_TAGS_H
#define SF_POSE_TAGS_H

#include "../base/context.h"

typedef struct sf_tags sf_tags;

typedef struct sf_tag_seen {
    int id;
    double corner[4]
                 [2]; /* px, as sf_board_corner; top left, top right, bottom right, bottom left of the tag */
} sf_tag_seen;

/* Whether a family of that name is known; the number of its tags, 0: not known. Without libapriltag too. */
int sf_tags_in_family(const char *family);

/* SF_ERR_UNSUPPORTED: not built with libapriltag. */
sf_status sf_tags_create(sf_context *ctx, const char *family, int decimate, sf_tags **tags);
void sf_tags_destroy(sf_tags **tags);

/* All tags of the family in a grey picture, by id; the array is the detector's own until its next call. */
sf_status sf_tags_find(sf_tags *tags, const uint8_t *grey, size_t stride, int width, int height,
                       const sf_tag_seen **seen, size_t *count);

enum { SF_TAG_MOST_CELLS = 10 };

/* The cells of a tag's square, black border and all: *side x *side, 1 where black, row by row from the top
 * left. SF_ERR_UNSUPPORTED: not built with libapriltag. */
sf_status sf_tags_cells(sf_context *ctx, const char *family, int id, int *side,
                        uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS]);

#endif
