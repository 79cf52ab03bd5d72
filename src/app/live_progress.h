/* live_progress.h - what a live fit says on its way. */
#ifndef APP_LIVE_PROGRESS_H
#define APP_LIVE_PROGRESS_H

#include <jansson.h>

#include "app.h"

/* For the log, --progress json and the page alike. */
json_t *live_progress_json(const sf_live_progress *p);
/* What the user should do; NULL: nothing. */
const char *live_advice_word(sf_live_advice advice);
/* A line of progress, where one is due; `now`: it is. */
void live_show(progress_line *line, const sf_live_progress *p, int now);

#endif
