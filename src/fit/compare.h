/* compare.h - measures the fit's renders of views against their pictures. */
#ifndef SF_FIT_COMPARE_H
#define SF_FIT_COMPARE_H

#include "fitter.h"

/* PSNR of a view in dB, at full resolution with the model's present degree and the camera that was learned,
 * the render clamped to 0..1; NAN: wholly masked. SF_ERR_MEMORY, and as sf_view_open. */
sf_status sf_view_psnr(sf_fitter *fitter, const sf_view *view, double *psnr);

#endif
