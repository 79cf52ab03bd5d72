/* preview_fixture.h - a server and its clients. */
#ifndef TESTS_UNIT_PREVIEW_FIXTURE_H
#define TESTS_UNIT_PREVIEW_FIXTURE_H

#include "testing.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "preview/preview.h"

typedef struct answer {
    int code;
    char head[4096];
    uint8_t *body; /* free()d by the caller; followed by a 0 */
    size_t size;
} answer;

int preview_port_of(const sf_preview *p);
int preview_dial(int port);
void preview_send_text(int fd, const char *text);
answer preview_receive_answer(int fd);

/* A request as it is, with its headers, and its answer. */
answer preview_ask_raw(int port, const char *request);

/* `headers`: each with its end of line. */
answer preview_ask_with(const sf_preview *p, const char *method, const char *path, const char *headers,
                        const char *body);
answer preview_get(const sf_preview *p, const char *path);
int preview_code_of(answer a);

typedef struct fixture {
    sf_context *ctx;
    sf_preview *p;
} fixture;

fixture preview_open_with(const char *listen, const char *token);
fixture preview_open_one(void);
void preview_close_one(fixture *f);
sf_model *preview_some_model(sf_context *ctx, size_t count);
void preview_set_point(fixture *f, double seconds, double psnr);
void preview_header_value(const answer *a, const char *name, char *value, size_t size);

#endif
