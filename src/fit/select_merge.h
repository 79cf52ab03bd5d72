/* select_merge.h - pairs of Gaussians on trial: one of both stands for them, until it is clear what that costs. */
#ifndef SF_FIT_TRIAL_H
#define SF_FIT_TRIAL_H

#include "fitter.h"
#include "select_importance.h"

enum { SF_MERGE_STEPS = 100 /* that those on trial have to make up for what is missing */ };

/* Whether trials are worth looking at the views for; else they are only where these are looked at anyway. */
int sf_merges_promise(const sf_fitter *fitter);

/* Puts the pairs that are likely to cost least on trial. worth: of the model as it is;
 * its tiles, which are the trial's then, are what that is judged by, and its effects are those of the pairs.
 * SF_ERR_MEMORY: nothing is on trial. */
sf_status sf_merges_begin(sf_fitter *fitter, sf_importance *worth);

/* Ends the trial: pairs whose one has raised the squared error by no more than the price of the Gaussians
 * that it saves, and what nobody sees (`nothing`, the square of an error), lose them: they are marked in
 * screen_sum. The others are as they were, and their effects in worth not finite. */
void sf_merges_decide(sf_fitter *fitter, sf_importance *worth, double price, double nothing);

/* The model as if there had been no trial; also a copy of it, made since this began. */
void sf_merges_undo(const sf_merges *trials, sf_model *model);

#endif
