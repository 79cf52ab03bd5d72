/* follow.h - the poses of views that are not trained on, beside training views whose poses are refined. */
#ifndef SF_FIT_FOLLOW_H
#define SF_FIT_FOLLOW_H

#include "views.h"

/* Moves a given camera by what the corrections of the training views next to it have in common. When poses
 * and model move together by a smooth motion, this keeps the camera in its place before the model; its
 * picture is not used. The camera stays as it is where there are fewer than four refined views. */
void sf_follow_neighbours(const sf_view_states *views, sf_camera *camera);

/* A mean without what is in it by chance: m - e^2 / m if |m| is above its standard error e, else 0 (James and
 * Stein 1961). error2: e^2. */
double sf_shrunk_mean(double mean, double error2);

#endif
