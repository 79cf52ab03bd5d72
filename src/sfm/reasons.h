/* reasons.h - why photos were not placed, in words for who took them. */
#ifndef SF_SFM_REASONS_H
#define SF_SFM_REASONS_H

#include "reconstruction.h"

/* Why a photo that has no pose has none. */
const char *sf_photo_why_not(const sf_reconstruction *r, size_t photo);

/* Fails with SF_ERR_EMPTY and why no pair of photos begins a map, where their features or the pairs with a
 * geometry say more than what the mapper said; else SF_OK. */
sf_status sf_photos_why_none(const sf_reconstruction *r, const sf_matched_pair *pairs, size_t pair_count);

#endif
