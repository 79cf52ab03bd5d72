/* place_recognition.h - finds the keyframe that looks most like a picture, by thumbnails. */
#ifndef SF_LIVE_PLACE_RECOGNITION_H
#define SF_LIVE_PLACE_RECOGNITION_H

#include "keyframe_list.h"

/* A picture made small, its greys around 0 with squares that sum to 1. Returns the standard deviation of its
 * greys, 0..1. */
double sf_make_thumbnail(const sf_picture *picture, float thumbnail[SF_THUMBNAIL]);

/* The keyframe whose thumbnail correlates most with this one, after the `rank` better ones; NULL: there are
 * fewer. */
const sf_keyframe *sf_recognize_place(const sf_keyframes *keyframes, const float thumbnail[SF_THUMBNAIL],
                                      int rank);

#endif
