/* feature_list.h - the features of a picture while they are found: of more than wanted, the best stay. */
#ifndef SF_SFM_FEATURE_LIST_H
#define SF_SFM_FEATURE_LIST_H

#include "feature_types.h"

typedef struct sf_feature_list {
    sf_context *ctx;
    size_t most; /* that are wanted */
    size_t count, capacity;
    sf_keypoint *points;  /* [capacity] */
    uint8_t *descriptors; /* [capacity][SF_DESCRIPTOR] */
} sf_feature_list;

void sf_feature_list_init(sf_feature_list *list, sf_context *ctx, size_t most);
void sf_feature_list_free(sf_feature_list *list);

/* Room for one more: its descriptor, to be filled in. NULL: out of memory. */
uint8_t *sf_feature_list_add(sf_feature_list *list, const sf_keypoint *point);

/* Hands over the best, sorted, each once; the list is empty. */
sf_status sf_feature_list_take(sf_feature_list *list, sf_features *features);

#endif
