/* schedule.h - resolution, SH degree, learning rates and number of Gaussians at a fraction of the run, 0..1.
 */
#ifndef SF_FIT_SCHEDULE_H
#define SF_FIT_SCHEDULE_H

#include "fitter.h"

/* The finished fraction of the run: by steps, and by time where there is a limit. */
double sf_fraction(const sf_fitter *fitter);
/* The same where `time` of the time limit has passed, 0..1. */
double sf_fraction_at(const sf_fitter *fitter, double time);

/* Resolution levels are halvings of the pictures. The level that leaves a picture of this size (px) large
 * enough: `level`, or the highest below it. */
int sf_level_within(int level, int width, int height);
/* The finest level of the steps near this fraction. */
int sf_finest_level(const sf_fitter *fitter, double fraction);
/* The level of the step to come, for a picture of this size (px). */
int sf_scheduled_level(const sf_fitter *fitter, double fraction, int width, int height);
int sf_scheduled_degree(const sf_fitter *fitter, double fraction);

/* How many steps fit into `seconds`, if one at full resolution takes `step` seconds now. */
double sf_steps_in(const sf_fitter *fitter, double seconds, double step);
/* Sets the options that the user left to the schedule, for a run of about `steps`. */
void sf_plan_schedule(sf_fitter *fitter, double steps);

/* The fraction at which the run ends: 1, or earlier after an early cool-down. */
double sf_end_of_run(const sf_fitter *fitter);
/* Begins the cool-down now, before it is due; length: of the run, and no longer than planned. */
void sf_cool_down_early(sf_fitter *fitter, double fraction, double length);
int sf_cools_down_early(const sf_fitter *fitter);
/* A learning rate after cool-down and divergence recovery have lowered it. */
double sf_cooled_rate(const sf_fitter *fitter, double fraction, double rate);
/* Learning rate of a field, in the units of its parameters. */
double sf_scheduled_rate(const sf_fitter *fitter, double fraction, int field);

/* Whether this step ends with densification; and the number of Gaussians planned at a fraction. */
int sf_densification_is_due(const sf_fitter *fitter, double fraction);
size_t sf_planned_count(const sf_fitter *fitter, double fraction);

/* Mean cost of the steps that are left, relative to one now: for the estimate of the time left. */
double sf_cost_ahead(const sf_fitter *fitter, double fraction);

#endif
