/* options.h - checks the options of a fit. */
#ifndef SF_FIT_OPTIONS_H
#define SF_FIT_OPTIONS_H

#include <splatfit/fitter.h>

/* SF_ERR_ARGUMENT, with the option's name, if one is out of its range. */
sf_status sf_fit_options_check(sf_context *ctx, const sf_fit_options *options);

#endif
