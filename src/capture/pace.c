/* pace.c - frames that become due one after another on the monotonic clock, as those of a camera do. */
#include "pace.h"

#include <errno.h>

#include "../base/clock.h"

int64_t sf_pace_after(double fps, uint64_t number) {
    double after = (double)number * 1e9 / fps + 0.5;
    return after < 0x1p62 ? (int64_t)after : INT64_MAX / 2; /* 146 years */
}

static int64_t due(const sf_pace *p, uint64_t number) { return p->start_ns + sf_pace_after(p->fps, number); }

void sf_pace_sleep_until(int64_t time_ns) {
    struct timespec t = {(time_t)(time_ns / 1000000000), (long)(time_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
    }
}

/* The newest frame that is due; p->next is. */
static uint64_t newest_due(const sf_pace *p, int64_t now) {
    uint64_t number = (uint64_t)((double)(now - p->start_ns) * 1e-9 * p->fps);
    while (due(p, number + 1) <= now) number++;
    while (number > p->next && due(p, number) > now) number--;
    if (number < p->next) number = p->next;
    return p->frames && number >= p->frames ? p->frames - 1 : number;
}

static sf_status wait_for_next(sf_pace *p, sf_context *ctx, const char *name, int timeout_ms) {
    int64_t now = sf_clock_ns(), deadline = now + (int64_t)timeout_ms * 1000000;
    if (!p->start_ns) p->start_ns = now;
    int64_t time_ns = due(p, p->next);
    if (time_ns <= now) return SF_OK;
    sf_pace_sleep_until(time_ns < deadline ? time_ns : deadline);
    if (time_ns <= deadline) return SF_OK;
    return sf_fail(ctx, SF_ERR_TIMEOUT, "%s: no frame within %d ms", name, timeout_ms);
}

sf_status sf_pace_next(sf_pace *p, sf_context *ctx, const char *name, int timeout_ms, int newest,
                       sf_source_counts *counts, sf_pace_frame *frame) {
    if (p->frames && p->next == p->frames)
        return sf_fail(ctx, SF_ERR_END, "%s: no more frames after %llu", name, (unsigned long long)p->next);
    if (p->fps == 0) {
        frame->number = p->next++;
        frame->time_ns = (int64_t)(frame->number * 1000000000 / 30);
        return SF_OK;
    }
    sf_status status = wait_for_next(p, ctx, name, timeout_ms);
    if (status != SF_OK) return status;
    uint64_t last = newest_due(p, sf_clock_ns()), first = p->next;
    if (last - first >= SF_PACE_WAITING) first = last - SF_PACE_WAITING + 1;
    frame->number = newest ? last : first;
    frame->time_ns = due(p, frame->number);
    counts->dropped += first - p->next;
    counts->skipped += frame->number - first;
    p->next = frame->number + 1;
    return SF_OK;
}
