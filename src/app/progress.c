/* progress.c - one line a moment about what goes on: rewritten on a terminal, plain lines or JSON otherwise.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "app.h"

/* Whether a line there can be written over. */
static int is_terminal(FILE *out) {
    const char *name = getenv("TERM");
    return isatty(fileno(out)) && name && *name && strcmp(name, "dumb") != 0;
}

/* Characters of a terminal's line that may be filled: a full one would break. */
static size_t room_of(FILE *out) {
    struct winsize size;
    return ioctl(fileno(out), TIOCGWINSZ, &size) || size.ws_col < 2 ? 79 : size.ws_col - 1u;
}

int progress_start(progress_line *line, const args *a, FILE *out) {
    const char *kind = args_value(a, "progress");
    *line = (progress_line){.out = out, .last = -1e9};
    if (args_value(a, "quiet") && !kind)
        line->kind = PROGRESS_NONE;
    else if (!kind || !strcmp(kind, "auto"))
        line->kind = is_terminal(out) ? PROGRESS_BAR : PROGRESS_PLAIN;
    else if (!strcmp(kind, "plain"))
        line->kind = PROGRESS_PLAIN;
    else if (!strcmp(kind, "json"))
        line->kind = PROGRESS_JSON;
    else if (!strcmp(kind, "none"))
        line->kind = PROGRESS_NONE;
    else {
        args_error(a->command, "--progress: \"%s\" is none of auto, plain, json, none", kind);
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
        if (s < 3600)
            snprintf(eta, sizeof eta, "  ETA %ld:%02ld", s / 60, s % 60);
        else
            snprintf(eta, sizeof eta, "  ETA %ld:%02ld:%02ld", s / 3600, s / 60 % 60, s % 60);
    }
    snprintf(text, room, "step %lld%s  loss %.4f  N %zu  %.3g steps/s%s", (long long)p->step, steps, p->loss,
             p->gaussians, p->steps_per_second, eta);
}

/* "[#####...............]  27 %  "; nothing of a run without an end. Returns its length. */
static size_t draw_bar(const sf_fit_progress *p, char *text, size_t room) {
    static const char full[] = "####################", empty[] = "....................";
    enum { CELLS = sizeof full - 1 };
    if (!(p->fraction >= 0 && p->fraction <= 1) || !isfinite(p->eta_seconds)) return 0;
    int done = (int)(CELLS * p->fraction);
    return (size_t)snprintf(text, room, "[%.*s%.*s] %3d %%  ", done, full, CELLS - done, empty,
                            (int)(100 * p->fraction));
}

int progress_due(progress_line *line, double seconds, int now) {
    static const double interval[] = {[PROGRESS_BAR] = 0.1, [PROGRESS_PLAIN] = 5, [PROGRESS_JSON] = 0.5};
    if (line->kind == PROGRESS_NONE) return 0;
    if (!now && seconds - line->last < interval[line->kind]) return 0;
    line->last = seconds;
    return 1;
}

void progress_text(progress_line *line, const char *text) {
    if (line->kind == PROGRESS_BAR)
        fprintf(line->out, "\r\033[K%.*s", (int)room_of(line->out), text);
    else
        fprintf(line->out, "%s\n", text);
    line->open = line->kind == PROGRESS_BAR;
    fflush(line->out);
}

void progress_show(progress_line *line, const sf_fit_progress *p, int now) {
    char text[256];
    if (!progress_due(line, p->seconds, now)) return;
    if (line->kind == PROGRESS_JSON) {
        print_json(line, p);
        fflush(line->out);
    } else {
        size_t n = line->kind == PROGRESS_BAR ? draw_bar(p, text, sizeof text) : 0;
        describe(p, text + n, sizeof text - n);
        progress_text(line, text);
    }
}

void progress_break(progress_line *line) {
    if (line->open) fprintf(line->out, "\n");
    line->open = 0;
}
