/* features.h - points of a photo that other photos of the same place show too, with a descriptor of each
 * point's surroundings (README.md, S.1 to S.6). */
#ifndef SF_SFM_FEATURES_H
#define SF_SFM_FEATURES_H

#include "feature_types.h"

sf_features_options sf_features_options_default(void);

/* Finds the features of a picture, on the calling thread. The result does not depend on level or machine.
 * SF_ERR_ARGUMENT: a size beyond the limits; SF_ERR_MEMORY: features is empty. A picture of less than 16 px a
 * side has none. */
sf_status sf_features_find(sf_context *ctx, const sf_photo *picture, const sf_features_options *options,
                           sf_features *features);

/* Finds those of `count` pictures, on all threads of the context. On failure all are empty. */
sf_status sf_features_find_all(sf_context *ctx, const sf_photo *pictures, size_t count,
                               const sf_features_options *options, sf_features *features);

void sf_features_free(sf_context *ctx, sf_features *features);

/* Bytes that sf_features_find takes at most while it runs, the result included: 9.6 KB a column of the
 * first octave, whatever the height, and 700 bytes a feature. */
uint64_t sf_features_memory(int width, int height, const sf_features_options *options);

#endif
