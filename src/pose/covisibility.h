/* covisibility.h - which keyframes see the same landmarks, and landmarks that go where their keyframes go. */
#ifndef SF_POSE_COVISIBILITY_H
#define SF_POSE_COVISIBILITY_H

#include "landmarks.h"
#include "pose_graph.h"

/* How many landmarks the keyframes ids[count] share, and the picture with them: shared [count + 1][count +
 * 1], symmetric, the picture last; its matches are those that count for its pose. SF_ERR_MEMORY. */
sf_status sf_landmarks_count_shared(const sf_landmarks *landmarks, const uint32_t *ids, size_t count,
                                    uint32_t *shared);

/* What is known of a keyframe's pose from outside; 0: nothing, or there is no such keyframe. */
int sf_landmarks_prior(const sf_landmarks *landmarks, uint32_t id, sf_track_prior *prior);

/* Landmarks that the picture shows, of known places: `at` [most][3] (world) and `pixels` [most][2]. Returns
 * how many. */
size_t sf_landmarks_seen(const sf_landmarks *landmarks, double (*at)[3], double (*pixels)[2], size_t most);

/* The same of a keyframe. */
size_t sf_landmarks_seen_by(const sf_landmarks *landmarks, uint32_t id, double (*at)[3], double (*pixels)[2],
                            size_t most);

/* A keyframe's pose becomes `to`, of a map whose unit of length is `scale` times the old one there. What was
 * first seen in it goes with it. */
void sf_landmarks_move(sf_landmarks *landmarks, uint32_t id, const sf_rigid *to, double scale);

#endif
