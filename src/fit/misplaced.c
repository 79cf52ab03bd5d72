/* misplaced.c - finds training views with a wrong pose among those far from all others.
 *
 * A camera far away may be right: a view of the whole from a hill. So its picture decides. It is trained on
 * like the others at first, so that what it alone sees is modelled too. A wrong pose contradicts what the
 * other views agree on, and its picture stays unlike its render.
 */
#include "misplaced.h"

#include <math.h>

#include "../base/statistics.h"
#include "compare.h"

/* Views are judged once, at this fraction of the run. */
#define MEASURE_AT 0.3
/* A picture whose PSNR is this much below the others' median, in dB, does not fit. */
#define WORSE 6.0

enum { FAR_MOST = 64, OTHERS = 9 };

static sf_status psnr_of(sf_fitter *f, uint32_t id, double *psnr) {
    sf_view *view = sf_scene_retain_id(f->scene, id);
    *psnr = NAN;
    sf_status status = view ? sf_view_psnr(f, view, psnr) : SF_OK;
    sf_view_release(view);
    return status;
}

static int is_listed(const sf_far_view *far, size_t count, uint32_t id) {
    size_t i = 0;
    while (i < count && far[i].id != id) i++;
    return i < count;
}

/* Median PSNR of up to OTHERS training views that are not far, evenly chosen; NAN: there is none. */
static sf_status median_of_others(sf_fitter *f, const sf_far_view *far, size_t far_count, double *median) {
    uint32_t *ids;
    size_t count, kept = 0, measured = 0;
    double psnr[OTHERS];
    *median = NAN;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    for (size_t i = 0; i < count; i++)
        if (!is_listed(far, far_count, ids[i])) ids[kept++] = ids[i];
    size_t wanted = kept < OTHERS ? kept : OTHERS;
    for (size_t k = 0; k < wanted && !status; k++) {
        status = psnr_of(f, ids[k * kept / wanted], &psnr[measured]);
        measured += !isnan(psnr[measured]);
    }
    sf_free(f->ctx, ids);
    if (measured) *median = sf_median(psnr, measured);
    return status;
}

static sf_status judge(sf_fitter *f, const sf_far_view *far, size_t count) {
    double others;
    sf_status status = median_of_others(f, far, count, &others);
    for (size_t i = 0; i < count && !status; i++) {
        double psnr;
        status = psnr_of(f, far[i].id, &psnr);
        if (status || !(psnr < others - WORSE)) continue;
        f->misplaced.ids[f->misplaced.count++] = far[i].id;
        sf_log(
            f->ctx, SF_LOG_WARNING,
            "view %s: its camera is %.3g times as far from the cameras' middle as they usually are, and its "
            "picture does not fit (%.1f dB, others %.1f): the fit goes on without this view",
            far[i].name, far[i].times, psnr, others);
    }
    return status;
}

sf_status sf_find_misplaced_views(sf_fitter *f, double fraction) {
    sf_far_view far[FAR_MOST];
    if (f->misplaced.judged || fraction < MEASURE_AT || f->options.open_end) return SF_OK;
    f->misplaced.judged = 1;
    size_t count = sf_scene_far_views(f->scene, SF_SPLIT_TRAIN, far, FAR_MOST);
    if (!count || count > FAR_MOST) return SF_OK;
    sf_free(f->ctx, f->misplaced.ids); /* an empty one from a checkpoint */
    f->misplaced.ids = sf_alloc(f->ctx, count, sizeof *f->misplaced.ids);
    return f->misplaced.ids ? judge(f, far, count) : SF_ERR_MEMORY;
}

static int is_misplaced(const sf_misplaced *misplaced, uint32_t id) {
    size_t i = 0;
    while (i < misplaced->count && misplaced->ids[i] != id) i++;
    return i < misplaced->count;
}

void sf_skip_misplaced_views(sf_fitter *f) {
    size_t kept = 0;
    for (size_t i = 0; i < f->sampler.count; i++)
        if (!is_misplaced(&f->misplaced, f->sampler.ids[i])) f->sampler.ids[kept++] = f->sampler.ids[i];
    if (kept) f->sampler.count = kept;
}
