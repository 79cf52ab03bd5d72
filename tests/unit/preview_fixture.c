/* preview_fixture.c - see the header. */
#include "preview_fixture.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "preview/preview.h"

int preview_port_of(const sf_preview *p) {
    const char *colon = strchr(sf_preview_url(p) + strlen("http://"), ':');
    assert_non_null(colon);
    return atoi(colon + 1);
}

int preview_dial(int port) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_true(fd >= 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    struct timeval limit = {.tv_sec = 60};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    return fd;
}

void preview_send_text(int fd, const char *text) {
    size_t size = strlen(text);
    while (size > 0) {
        ssize_t sent = send(fd, text, size, MSG_NOSIGNAL);
        if (sent <= 0) return;
        text += sent;
        size -= (size_t)sent;
    }
}

/* All up to the end of the connection; *size bytes, followed by a 0. */
static uint8_t *receive(int fd, size_t *size) {
    size_t room = 1 << 14;
    uint8_t *data = malloc(room);
    ssize_t got;
    assert_non_null(data);
    *size = 0;
    while ((got = recv(fd, data + *size, room - *size - 1, 0)) > 0) {
        *size += (size_t)got;
        if (*size + 1 == room) assert_non_null(data = realloc(data, room *= 2));
    }
    data[*size] = 0;
    return data;
}

answer preview_receive_answer(int fd) {
    answer a = {0};
    size_t size;
    uint8_t *all = receive(fd, &size);
    char *end = strstr((char *)all, "\r\n\r\n");
    if (end) {
        size_t head = (size_t)(end - (char *)all) + 4;
        snprintf(a.head, sizeof a.head, "%.*s", (int)head, (char *)all);
        sscanf(a.head, "HTTP/1.1 %d", &a.code);
        a.size = size - head;
        memmove(all, all + head, a.size + 1);
    }
    a.body = all;
    close(fd);
    return a;
}

answer preview_ask_raw(int port, const char *request) {
    int fd = preview_dial(port);
    preview_send_text(fd, request);
    return preview_receive_answer(fd);
}

answer preview_ask_with(const sf_preview *p, const char *method, const char *path, const char *headers,
                        const char *body) {
    char request[4096];
    snprintf(request, sizeof request, "%s %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n%s\r\n%s", method, path,
             preview_port_of(p), headers, body);
    return preview_ask_raw(preview_port_of(p), request);
}

answer preview_get(const sf_preview *p, const char *path) { return preview_ask_with(p, "GET", path, "", ""); }

int preview_code_of(answer a) {
    free(a.body);
    return a.code;
}

fixture preview_open_with(const char *listen, const char *token) {
    fixture f = {.ctx = test_context()};
    sf_preview_options o = {.listen = listen, .token = token, .title = "a \"scene\" <b>"};
#ifndef SF_HAVE_CIVETWEB
    assert_status(f.ctx, sf_preview_open(f.ctx, &o, &f.p), SF_ERR_UNSUPPORTED);
    assert_error_names(f.ctx, "civetweb");
    sf_context_destroy(&f.ctx);
    test_skip("not built with civetweb");
#endif
    assert_ok(f.ctx, sf_preview_open(f.ctx, &o, &f.p));
    return f;
}

fixture preview_open_one(void) { return preview_open_with("127.0.0.1:0", NULL); }

void preview_close_one(fixture *f) {
    sf_preview_close(&f->p);
    assert_null(f->p);
    sf_context_destroy(&f->ctx);
}

sf_model *preview_some_model(sf_context *ctx, size_t count) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, 0, &model));
    for (size_t i = 0; i < count; i++) {
        float v = (float)(i % 97) / 97, mean[3] = {v, 1 - v, (float)i / 1000}, quat[4] = {1, v, 0, -v},
              scale[3] = {-4 + v, -5, -4 - v}, logit = 3 * v, sh[3] = {v, -v, 0.5f};
        sf_gaussians g = {mean, quat, scale, &logit, sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &g));
    }
    return model;
}

void preview_set_point(fixture *f, double seconds, double psnr) {
    char text[128];
    snprintf(text, sizeof text, "{\"seconds\": %g, \"held_out_psnr\": %g}", seconds, psnr);
    assert_ok(f->ctx, sf_preview_set_status(f->p, text));
}

void preview_header_value(const answer *a, const char *name, char *value, size_t size) {
    const char *at = strstr(a->head, name);
    assert_non_null(at);
    at += strlen(name);
    snprintf(value, size, "%.*s", (int)strcspn(at, "\r"), at);
}
