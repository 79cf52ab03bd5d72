/* signals.c - signals that end a run: caught, told, passed on. */
#include <signal.h>
#include <time.h>

#include "app.h"

static volatile sig_atomic_t stopped_by;
static void (*when_stopped)(void);
static struct timespec when_first; /* the first signal came; written and read in the handler alone */

/* Seconds after the first signal in which another is taken for the same: timeout(1), say, signals the program
 * and then its whole group. */
static const double SAME_SIGNAL = 1;

static void on_signal(int number) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (!stopped_by) {
        stopped_by = number;
        when_first = now;
        if (when_stopped) when_stopped();
    } else if ((double)(now.tv_sec - when_first.tv_sec) + 1e-9 * (double)(now.tv_nsec - when_first.tv_nsec) >
               SAME_SIGNAL) {
        signal(number, SIG_DFL);
        raise(number);
    }
}

/* The handler is not interrupted by another of these, so what it keeps needs no lock. */
static struct sigaction caught_action(void) {
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaddset(&action.sa_mask, SIGINT);
    sigaddset(&action.sa_mask, SIGTERM);
    sigaddset(&action.sa_mask, SIGHUP);
    return action;
}

void app_catch_signals(void (*fn)(void)) {
    const struct sigaction action = caught_action();
    when_stopped = fn;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    struct sigaction before;
    if (!sigaction(SIGHUP, NULL, &before) && before.sa_handler != SIG_IGN) /* under nohup it goes on */
        sigaction(SIGHUP, &action, NULL);
}

int app_stopped_by(void) { return stopped_by; }

static sf_context *volatile loads; /* the context that loads a scene */

static void cancel_loads(void) { sf_scene_cancel_loads(loads); }

/* A signal ends the program as if it were not caught, but after the load, which leaves no unpacked archive.
 */
int app_load_caught(const args *a, sf_context *ctx, const char *path, const sf_load_options *options,
                    sf_scene **scene) {
    enum { CAUGHT = 3 };
    static const int caught[CAUGHT] = {SIGINT, SIGTERM, SIGHUP};
    const struct sigaction action = caught_action();
    struct sigaction before[CAUGHT];
    loads = ctx;
    when_stopped = cancel_loads;
    for (int i = 0; i < CAUGHT; i++)
        if (!sigaction(caught[i], NULL, &before[i]) && before[i].sa_handler != SIG_IGN)
            sigaction(caught[i], &action, NULL);
    sf_status status = sf_scene_load(ctx, path, options, scene);
    for (int i = 0; i < CAUGHT; i++) sigaction(caught[i], &before[i], NULL);
    when_stopped = NULL;
    if (stopped_by) raise(stopped_by);
    return status ? app_fail(a, ctx) : 0;
}
