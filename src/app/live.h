/* live.h - the page of a live fit. */
#ifndef APP_LIVE_H
#define APP_LIVE_H

#include "../preview/preview.h"
#include "app.h"

typedef struct page {
    sf_preview *preview;     /* NULL: none is served */
    double next, next_model; /* s of the run */
    float *rgb;              /* a render */
    uint8_t *bytes;
    size_t capacity; /* pixels of both */
} page;

typedef enum page_word {
    PAGE_NOTHING,
    PAGE_PAUSE,
    PAGE_GO_ON,
    PAGE_SAVE,
    PAGE_RESET,
    PAGE_LOCK,
    PAGE_UNLOCK
} page_word;

/* Serves it as --listen and --token say, and says where. An address that nobody asked for and that is taken,
 * or a build without it, is no failure. 0 or an exit code. */
int page_open(page *p, const args *a, sf_context *ctx);
void page_close(page *p);
/* Whether it is time to show something new. */
int page_due(page *p, double seconds);
/* Shows the frame, the render from there, the figures (takes the reference) and now and then the model. */
void page_show(page *p, sf_live *live, json_t *figures);
/* The next button that somebody pressed. */
page_word page_command(page *p);

#endif
