/* live_progress.c - see live_progress.h. */
#include "live_progress.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const char *state_word(const sf_live_progress *p) {
    static const char *const words[SF_LIVE_STATE_COUNT] = {[SF_LIVE_WAITING] = "waiting for a first pose",
                                                           [SF_LIVE_STARTING] = "starting: move sideways",
                                                           [SF_LIVE_TRACKING] = "tracking",
                                                           [SF_LIVE_LOST] = "lost: go back to where it was"};
    static const char *const troubles[SF_LIVE_TROUBLE_COUNT] = {
        [SF_LIVE_SILENT] = "no frame comes: wait, is the camera there?",
        [SF_LIVE_BLANK] = "lost: is the lens covered?",
        [SF_LIVE_BLURRED] = "wait: the pictures are blurred"};
    return p->paused ? "paused" : troubles[p->trouble] ? troubles[p->trouble] : words[p->state];
}

static json_t *number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

const char *live_advice_word(sf_live_advice advice) {
    static const char *const words[SF_ADVICE_COUNT] = {
        [SF_ADVICE_SIDEWAYS] = "move sideways",
        [SF_ADVICE_SLOWER] = "slower",
        [SF_ADVICE_DARKER] = "darker than the rest: more light?",
        [SF_ADVICE_BRIGHTER] = "brighter than the rest: less light?",
        [SF_ADVICE_COME_BACK] = "go back to where it was",
        [SF_ADVICE_MORE_VIEWS] = "move around this: it needs more views"};
    return words[advice];
}

json_t *live_progress_json(const sf_live_progress *p) {
    return json_pack("{s:s, s:f, s:I, s:I, s:f, s:f, s:f, s:f, s:I, s:I, s:I, s:I, s:I, s:o, s:o, s:o, s:I, "
                     "s:I, s:f, s:s?}",
                     "state", state_word(p), "seconds", p->seconds, "gaussians", (json_int_t)p->fit.gaussians,
                     "steps", (json_int_t)p->fit.step, "steps_per_second", p->fit.steps_per_second,
                     "frames_per_second", p->frame_rate, "tracked_per_second", p->track_rate, "track_ms",
                     p->track_ms, "dropped", (json_int_t)(p->frames.dropped + p->frames.skipped),
                     "passed_over", (json_int_t)p->passed_over, "keyframes", (json_int_t)p->keyframes,
                     "held_out", (json_int_t)p->held_out, "lost", (json_int_t)p->lost, "held_out_psnr",
                     number(p->held_out_psnr), "held_out_psnr_corrected", number(p->held_out_psnr_corrected),
                     "first_psnr", number(p->first_psnr), "looked_at", (json_int_t)p->looked_at, "tracked",
                     (json_int_t)p->tracked, "duty", p->duty, "advice", live_advice_word(p->advice));
}

/* Than the word for the state, which may say what to do itself. */
static int says_more(const sf_live_progress *p) {
    return !p->paused && !p->trouble && p->state == SF_LIVE_TRACKING;
}

void live_show(progress_line *line, const sf_live_progress *p, int now) {
    if (!progress_due(line, p->seconds, now)) return;
    if (line->kind == PROGRESS_JSON) {
        json_t *json = live_progress_json(p);
        char *text = json ? json_dumps(json, JSON_COMPACT | JSON_REAL_PRECISION(6)) : NULL;
        if (text) progress_text(line, text);
        free(text);
        json_decref(json);
        return;
    }
    char text[256], psnr[48] = "";
    if (isfinite(p->held_out_psnr_corrected))
        snprintf(psnr, sizeof psnr, "  held out %.2f dB", p->held_out_psnr_corrected);
    const char *advice = says_more(p) ? live_advice_word(p->advice) : NULL;
    snprintf(text, sizeof text, "%.0f s  %s%s%s  %.0f poses/s  %zu keyframes  N %zu  %.3g steps/s%s",
             p->seconds, state_word(p), advice ? ": " : "", advice ? advice : "", p->track_rate, p->keyframes,
             p->fit.gaussians, p->fit.steps_per_second, psnr);
    progress_text(line, text);
}
