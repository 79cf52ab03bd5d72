/* messages.h - what the program shows and the page's buttons ask for. */
#ifndef SF_PREVIEW_MESSAGES_H
#define SF_PREVIEW_MESSAGES_H

/* What the page shows: bits of sf_preview_wants. */
typedef enum sf_preview_part {
    SF_PREVIEW_CAMERA = 1, /* the newest picture of the camera */
    SF_PREVIEW_RENDER = 2, /* the model, rendered from where that was taken */
    SF_PREVIEW_MODEL = 4,  /* the model that the page draws by itself */
    SF_PREVIEW_STATUS = 8,
    SF_PREVIEW_COVERAGE = 16 /* `coverage` of the status, laid over the camera's picture */
} sf_preview_part;

typedef enum sf_preview_command {
    SF_PREVIEW_PAUSE = 1,
    SF_PREVIEW_GO_ON,
    SF_PREVIEW_SAVE,
    SF_PREVIEW_RESET,
    SF_PREVIEW_LOCK_EXPOSURE,
    SF_PREVIEW_UNLOCK_EXPOSURE
} sf_preview_command;

#endif
