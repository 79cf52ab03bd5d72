/* status.h - what every call that can fail returns. */
#ifndef SPLATFIT_STATUS_H
#define SPLATFIT_STATUS_H

#if defined(__GNUC__)
/* Marks what the shared library shows. */
#define SF_API __attribute__((visibility("default")))
#else
#define SF_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The outcome of a call. Numbers stay what they are; new ones may come. */
typedef enum sf_status {
    SF_OK = 0,              /* it did what it says */
    SF_ERR_ARGUMENT = 1,    /* a value outside its documented range; nothing was changed */
    SF_ERR_MEMORY = 2,      /* an allocation failed; nothing was changed */
    SF_ERR_IO = 3,          /* the operating system refused to open, read or write */
    SF_ERR_FORMAT = 4,      /* a file's content contradicts its format */
    SF_ERR_UNSUPPORTED = 5, /* valid, but not built or not offered */
    SF_ERR_EMPTY = 6,       /* nothing to work on: no view, no Gaussian */
    SF_ERR_CANCELLED = 7,   /* it was cancelled; a fitter is whole and can go on */
    SF_ERR_TIMEOUT = 8,     /* a bounded wait ended first */
    SF_ERR_END = 9          /* there is no more: frames, steps, entries of a list */
} sf_status;

/* A few words for a status, for example "out of memory". Never NULL, never freed. */
SF_API const char *sf_status_text(sf_status status);

#ifdef __cplusplus
}
#endif
#endif
