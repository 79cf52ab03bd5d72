/* browser.h - a headless Chromium, led over a pipe by its remote debugging protocol. */
#ifndef PREVIEW_BROWSER_H
#define PREVIEW_BROWSER_H

#include "../testing.h"

#include <sys/types.h>

typedef struct browser {
    pid_t pid;
    int to, from; /* pipes */
    int calls;
    int exceptions; /* that a page's scripts did not catch */
    char session[64];
    char *pending; /* of an answer that is not whole */
    size_t used, room;
} browser;

/* Starts one and opens a page of that size in px; the test is skipped where there is no Chromium
 * (SPLATFIT_CHROMIUM, else chromium of the PATH). */
browser browser_start(int width, int height);
void browser_stop(browser *b);

/* One call of the protocol; `parameters` is taken. The result is the caller's; an error fails the test. */
json_t *browser_call(browser *b, const char *method, json_t *parameters);

void browser_open(browser *b, const char *url);
void browser_resize(browser *b, int width, int height, double ratio, int phone);
/* "dark" or "light". */
void browser_scheme(browser *b, const char *scheme);

/* What an expression gives: a number (true: 1), or its text in one of 4 buffers used in turn. */
double browser_number(browser *b, const char *expression);
const char *browser_text(browser *b, const char *expression);

/* Waits until an expression is true, up to 30 s, or fails the test. */
void browser_await(browser *b, const char *expression);

/* Presses the left button at the middle of the element. */
void browser_click(browser *b, const char *selector);
/* type: mousePressed, mouseMoved, mouseReleased; touchStart, touchMove, touchEnd of n fingers. */
void browser_mouse(browser *b, const char *type, double x, double y);
void browser_touch(browser *b, const char *type, int n, const double (*at)[2]);

/* The screen, or what of it the element covers, as a PNG file. */
void browser_picture(browser *b, const char *selector, const char *path);

/* What the page shows of an element, width by height, as RGB in 0..1, pixel by pixel; the caller frees it. */
float *browser_pixels(browser *b, sf_context *ctx, const char *selector, int width, int height);

#endif
