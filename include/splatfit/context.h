/* context.h - the state that all objects share: memory, messages, threads, the level of the kernels.
 *
 * The library has no globals, never exits and never prints: it reports through the log callback, the status
 * of a call and sf_last_error. A context outlives every object created with it.
 */
#ifndef SPLATFIT_CONTEXT_H
#define SPLATFIT_CONTEXT_H

#include <stddef.h>

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Allocator, log, threads and kernels, shared by all objects that are created with it. */
typedef struct sf_context sf_context;

/* How much a line of the log matters. */
typedef enum sf_log_level {
    SF_LOG_DEBUG,  /* for finding faults */
    SF_LOG_INFO,   /* something was done or left out, as it should be */
    SF_LOG_WARNING /* the user should know: the result may not be the intended one */
} sf_log_level;

/* Receives one line, without its newline. Called from the thread that made the call in progress, or from a
 * thread of the pool, one call at a time. It must not call the library. */
typedef void (*sf_log_fn)(void *user, sf_log_level level, const char *message);

/* An allocator. alloc returns `size` bytes aligned for any type, or NULL; free takes a block that alloc
 * returned. Both are called from any thread. Where the library needs a larger alignment it adds it itself. */
typedef struct sf_allocator {
    void *(*alloc)(void *user, size_t size);
    void (*free)(void *user, void *block);
    void *user; /* passed to both */
} sf_allocator;

/* All 0 is the default. */
typedef struct sf_context_options {
    const sf_allocator *allocator; /* NULL: malloc and free */
    sf_log_fn log;                 /* NULL: silent */
    void *log_user;                /* passed to log */
    int threads;                   /* 1..256; 0: as many as the affinity mask and the control group allow */
    const char *isa;               /* a kernel level by name (sf_isa_describe); NULL: the one that the
                                      environment variable SPLATFIT_ISA names, else the machine's best */
} sf_context_options;

/* Creates a context and its threads. `options` may be NULL. On failure *context is NULL.
 * SF_ERR_ARGUMENT: threads out of range, unknown isa; SF_ERR_UNSUPPORTED: a level that this machine lacks. */
SF_API sf_status sf_context_create(sf_context **context, const sf_context_options *options);

/* Stops the threads and sets *context to NULL. Destroy all objects of the context first. NULL is allowed.
 */
SF_API void sf_context_destroy(sf_context **context);

/* The message of the last call on this context that failed; it names the file, the field and the value at
 * fault. "" if no call failed. The text is valid until the next failing call on the context. */
SF_API const char *sf_last_error(const sf_context *context);

/* Number of threads in use (including the caller's), 1..256. */
SF_API int sf_context_threads(const sf_context *context);

/* Name of the kernel level in use, for example "avx2". */
SF_API const char *sf_context_isa(const sf_context *context);

/* A level of the kernels. The name "scalar" exists everywhere, the others are those of instruction sets. */
typedef struct sf_isa_info {
    const char *name;
    int built;  /* the library contains it */
    int usable; /* the library contains it and this machine can run it */
} sf_isa_info;

/* Level `index`, lowest first. SF_ERR_END past the last. */
SF_API sf_status sf_isa_describe(size_t index, sf_isa_info *info);

/* A kernel, and the level at which a context runs it. */
typedef struct sf_kernel_info {
    const char *name; /* "blend", for example */
    const char *isa;  /* as in sf_isa_info */
} sf_kernel_info;

/* Kernel `index`, in the order of a step. SF_ERR_END past the last. */
SF_API sf_status sf_kernel_describe(const sf_context *context, size_t index, sf_kernel_info *info);

/* The version of these headers, "major.minor.patch". */
#define SF_VERSION "0.2.0"

/* The version of the binary interface that these headers describe: N of libsplatfit.so.N. README.md beside
 * them says what is promised. */
#define SF_ABI 1

/* The version of the library in use, in the form of SF_VERSION. */
SF_API const char *sf_version(void);

#ifdef __cplusplus
}
#endif
#endif
