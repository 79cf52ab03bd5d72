/* guest.h - tests that run inside the emulated board: each in a separate process, with a time limit. */
#ifndef GUEST_H
#define GUEST_H

#include <splatfit/splatfit.h>

typedef struct guest_test {
    const char *name;
    void (*run)(void);
} guest_test;

/* Tables that end with a test without a name. */
extern const guest_test vivid_tests[], fault_tests[], uvc_tests[], libcamera_tests[], virtual_tests[],
    live_tests[];

/* Ends the test as failed, with the reason printed. */
_Noreturn void fail(const char *format, ...) __attribute__((format(printf, 1, 2)));
/* Ends it as skipped. */
_Noreturn void skip(const char *reason);

#define check(condition, ...)                                                                                \
    do {                                                                                                     \
        if (!(condition)) fail(__VA_ARGS__);                                                                 \
    } while (0)

void sleep_ms(int ms);
int64_t now_ms(void);

/* The context of the test; what it logs is printed with the test's failure, and kept. */
sf_context *guest_context(void);
/* Whether a line that was logged holds `part`. */
int was_logged(const char *part);

sf_source *open_source(const char *format, ...) __attribute__((format(printf, 1, 2)));
/* The next frame within `timeout_ms`, as often as that runs out within 20 s. */
void next_frame(sf_source *source, int timeout_ms, sf_frame *frame);
sf_source_counts counts_of(const sf_source *source);

/* Takes `count` frames and checks that each is a pattern, ids and sequence going up. The first id. */
int64_t take_exact(sf_source *source, int count);

/* The capture node of a camera whose name begins with `name`, "/dev/videoN", waited for 10 s. */
void find_node(const char *name, char node[32]);
int node_exists(const char *name);

#endif
