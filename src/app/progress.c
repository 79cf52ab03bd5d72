/* progress.c - one line a moment about what goes on: rewritten on a terminal, plain lines or JSON otherwise.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "app.h"

int progress_start(progress_line *line, const args *a, FILE *out) {
    const char *kind = args_value(a, "progress");
    *line = (progress_line){.out = out, .last = -1e9};
    if (args_value(a, "quiet") && !kind)
        line->kind = PROGRESS_NONE;
    else if (!kind || !strcmp(kind, "auto"))
        line->kind = isatty(fileno(out)) ? PROGRESS_BAR : PROGRESS_PLAIN;
    else if (!strcmp(kind, "plain"))
        line->kind = PROGRESS_PLAIN;
    else if (!strcmp(kind, "json"))
        line->kind = PROGRESS_JSON;
    else if (!strcmp(kind, "none"))
        line->kind = PROGRESS_NONE;
    else {
        fprintf(stderr, "splatfit %s: --progress: \"%s\" is none of auto, plain, json, none\n",
                a->command->name, kind);
        return EXIT_USAGE;
    }
    return 0;
}

static void print_json(const progress_line *line, const sf_fit_progress *p) {
    fprintf(line->out,
            "{\"step\": %lld, \"steps\": %lld, \"fraction\": %.6f, \"seconds\": %.3f, \"loss\": %.6g, "
            "\"gaussians\": %zu, \"steps_per_second\": %.4g, \"eta_seconds\": %.1f, \"level\": %d, "
            "\"sh_degree\": %d, \"turned_degrees\": %.4f, \"moved_depths\": %.5f, \"focal_change\": %.5f}\n",
            (long long)p->step, (long long)p->steps, p->fraction, p->seconds,
            isfinite(p->loss) ? p->loss : -1.0, p->gaussians, p->steps_per_second,
            isfinite(p->eta_seconds) ? p->eta_seconds : -1.0, p->level, p->sh_degree, p->turned_degrees,
            p->moved_depths, p->focal_change);
}

static void describe(const sf_fit_progress *p, char *text, size_t room) {
    char steps[32] = "", eta[32] = "";
    if (p->steps) snprintf(steps, sizeof steps, "/%lld", (long long)p->steps);
    if (isfinite(p->eta_seconds) && p->eta_seconds < 3.6e6) {
        long s = (long)(p->eta_seconds + 0.5);
        snprintf(eta, sizeof eta, "  ETA %ld:%02ld", s / 60, s % 60);
    }
    snprintf(text, room, "step %lld%s  loss %.4f  N %zu  %.3g steps/s%s", (long long)p->step, steps, p->loss,
             p->gaussians, p->steps_per_second, eta);
}

int progress_due(progress_line *line, double seconds, int now) {
    static const double interval[] = {[PROGRESS_BAR] = 0.1, [PROGRESS_PLAIN] = 5, [PROGRESS_JSON] = 0.5};
    if (line->kind == PROGRESS_NONE) return 0;
    if (!now && seconds - line->last < interval[line->kind]) return 0;
    line->last = seconds;
    return 1;
}

void progress_text(progress_line *line, const char *text) {
    fprintf(line->out, line->kind == PROGRESS_BAR ? "\r\033[K%s" : "%s\n", text);
    line->open = line->kind == PROGRESS_BAR;
    fflush(line->out);
}

void progress_show(progress_line *line, const sf_fit_progress *p, int now) {
    char text[192];
    if (!progress_due(line, p->seconds, now)) return;
    if (line->kind == PROGRESS_JSON) {
        print_json(line, p);
        fflush(line->out);
    } else {
        describe(p, text, sizeof text);
        progress_text(line, text);
    }
}

void progress_break(progress_line *line) {
    if (line->open) fprintf(line->out, "\n");
    line->open = 0;
}
