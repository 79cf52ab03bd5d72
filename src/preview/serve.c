/* serve.c - see serve.h. One function a request; threads are civetweb's.
 *
 * A connection is one request: a client that keeps its connection would keep a thread. Who does not send or
 * take for some seconds is let go.
 */
#include "serve.h"

#ifdef SF_HAVE_CIVETWEB

#include <arpa/inet.h>
#include <civetweb.h>
#include <jansson.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum {
    PART = 32768, /* bytes written at a time, each within the limit of time */
    BODY = 256,   /* bytes of a command at most */
    HEADERS = 512
};

/* No script, style or picture of elsewhere; no frame of another page around this one. */
#define POLICY                                                                                               \
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src 'self' data: "       \
    "blob:; "                                                                                                \
    "connect-src 'self'; worker-src blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"

typedef struct mg_connection connection;

typedef struct request {
    sf_preview_server *server;
    connection *to;
    const struct mg_request_info *info;
} request;

/* ---- Answers ---- */

/* Status line and headers; `more` is headers, each with its end of line. */
static void put_head(const request *r, int code, const char *text, const char *type, size_t size,
                     const char *more) {
    mg_printf(r->to,
              "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %llu\r\nConnection: close\r\n"
              "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n"
              "Cross-Origin-Resource-Policy: same-origin\r\n%s\r\n",
              code, text, type, (unsigned long long)size, more);
}

static int is(const char *a, const char *b) { return !strcmp(a, b); }

/* HEAD asks for the headers alone. */
static int wants_body(const request *r) { return !is(r->info->request_method, "HEAD"); }

/* Each part has its time: who takes nothing for so long is let go. */
static void put_body(const request *r, const void *data, size_t size) {
    const char *from = data;
    while (size > 0 && wants_body(r)) {
        size_t part = size < PART ? size : PART;
        if (mg_write(r->to, from, part) != (int)part) return;
        from += part;
        size -= part;
    }
}

static int answer(const request *r, int code, const char *text, const char *type, const void *data,
                  size_t size, const char *more) {
    put_head(r, code, text, type, size, more);
    put_body(r, data, size);
    return code;
}

/* One line for people and programs. */
static int refuse(const request *r, int code, const char *text, const char *line) {
    return answer(r, code, text, "text/plain; charset=utf-8", line, strlen(line), "");
}

static int no_memory(const request *r) { return refuse(r, 503, "Service Unavailable", "out of memory\n"); }

static int answer_json(const request *r, char *json) {
    if (!json) return no_memory(r);
    int code = answer(r, 200, "OK", "application/json", json, strlen(json), "");
    sf_free(r->server->ctx, json);
    return code;
}

static void tag_of(const request *r, uint64_t version, char *tag, size_t size) {
    snprintf(tag, size, "\"%s-%llu\"", r->server->session, (unsigned long long)version);
}

static const char *header(const request *r, const char *name) { return mg_get_header(r->to, name); }

/* Whether the client has it already. */
static int is_known(const request *r, const char *tag) {
    const char *has = header(r, "If-None-Match");
    return has && is(has, tag);
}

/* ---- What is asked for ---- */

static int get_page(const request *r) {
    char more[HEADERS];
    int used = snprintf(more, sizeof more, "Content-Security-Policy: %s\r\n", POLICY);
    /* The rest of the page's requests bring it so: the address bar need not show it. */
    if (*r->server->token)
        snprintf(more + used, sizeof more - (size_t)used,
                 "Set-Cookie: %s=%s; Path=/; HttpOnly; SameSite=Strict\r\n", r->server->cookie,
                 r->server->token);
    return answer(r, 200, "OK", "text/html; charset=utf-8", sf_preview_page, sf_preview_page_size, more);
}

/* `want` of the query: letters of what the page shows and could take something newer of. */
static int get_status(const request *r) {
    char want[8] = "";
    int parts = SF_PREVIEW_STATUS;
    const char *query = r->info->query_string;
    if (query) mg_get_var(query, strlen(query), "want", want, sizeof want);
    if (strchr(want, 'c')) parts |= SF_PREVIEW_CAMERA;
    if (strchr(want, 'r')) parts |= SF_PREVIEW_RENDER;
    if (strchr(want, 'm')) parts |= SF_PREVIEW_MODEL;
    if (strchr(want, 'o')) parts |= SF_PREVIEW_COVERAGE;
    sf_store_look(r->server->store, parts);
    return answer_json(r, sf_store_status_json(r->server->store, r->server->head));
}

static int get_history(const request *r) { return answer_json(r, sf_store_history_json(r->server->store)); }

static int get_picture(const request *r, sf_preview_part part) {
    uint8_t *jpeg;
    size_t size;
    uint64_t version;
    char tag[96], more[HEADERS];
    sf_store_look(r->server->store, part);
    sf_status status = sf_store_jpeg(r->server->store, part, &jpeg, &size, &version);
    if (status == SF_ERR_EMPTY) return refuse(r, 404, "Not Found", "no picture yet\n");
    if (status) return no_memory(r);
    tag_of(r, version, tag, sizeof tag);
    snprintf(more, sizeof more, "ETag: %s\r\n", tag);
    int code = is_known(r, tag) ? answer(r, 304, "Not Modified", "image/jpeg", "", 0, more)
                                : answer(r, 200, "OK", "image/jpeg", jpeg, size, more);
    sf_free(r->server->ctx, jpeg);
    return code;
}

static int get_camera(const request *r) { return get_picture(r, SF_PREVIEW_CAMERA); }
static int get_render(const request *r) { return get_picture(r, SF_PREVIEW_RENDER); }

/* The one range "bytes=FIRST-LAST" or "bytes=FIRST-" of `size` bytes. 0: not of that form, which is as if
 * there were none. */
static int read_range(const char *text, size_t size, size_t *first, size_t *last) {
    char *end;
    if (!text || strncmp(text, "bytes=", 6) || text[6] < '0' || text[6] > '9') return 0;
    unsigned long long a = strtoull(text + 6, &end, 10), b = size ? size - 1 : 0;
    if (*end++ != '-') return 0;
    if (*end >= '0' && *end <= '9') {
        unsigned long long asked = strtoull(end, &end, 10);
        if (asked < b) b = asked;
    }
    if (*end || (a <= b && a >= size)) return 0;
    *first = (size_t)a;
    *last = (size_t)b;
    return 1;
}

/* Part by part, each copied: nothing is held while the network takes its time. A model that two newer ones
 * have followed is gone; then the connection ends early, which the client sees by the length. */
static void put_model(const request *r, uint64_t version, sf_preview_piece piece, size_t at, size_t size) {
    uint8_t part[PART];
    while (size > 0 && wants_body(r)) {
        size_t n = size < sizeof part ? size : sizeof part;
        if (!sf_store_model_read(r->server->store, version, piece, at, n, part)) return;
        if (mg_write(r->to, part, n) != (int)n) return;
        at += n;
        size -= n;
    }
}

/* The version of an If-Match header where that is still here, else the newest. */
static uint64_t version_asked(const request *r, uint64_t newest) {
    const char *match = header(r, "If-Match");
    char tag[96];
    for (uint64_t v = newest; match && v > 0 && v + 1 >= newest; v--) {
        tag_of(r, v, tag, sizeof tag);
        if (is(match, tag)) return v;
    }
    return match ? 0 : newest;
}

static int get_piece(const request *r, sf_preview_piece piece) {
    uint64_t version = sf_store_model(r->server->store);
    size_t first = 0, last;
    char tag[96], more[HEADERS];
    if (!version) return refuse(r, 404, "Not Found", "no model yet\n");
    version = version_asked(r, version);
    size_t bytes = sf_store_model_bytes(r->server->store, version, piece);
    tag_of(r, version, tag, sizeof tag);
    if (!version) return refuse(r, 412, "Precondition Failed", "that model is no longer here\n");
    int used = snprintf(more, sizeof more, "ETag: %s\r\nAccept-Ranges: bytes\r\n", tag);
    if (is_known(r, tag)) return answer(r, 304, "Not Modified", "application/octet-stream", "", 0, more);
    int ranged = read_range(header(r, "Range"), bytes, &first, &last);
    if (ranged && first > last) {
        snprintf(more + used, sizeof more - (size_t)used, "Content-Range: bytes */%zu\r\n", bytes);
        return answer(r, 416, "Range Not Satisfiable", "text/plain", "", 0, more);
    }
    size_t size = ranged ? last - first + 1 : bytes;
    if (ranged)
        snprintf(more + used, sizeof more - (size_t)used, "Content-Range: bytes %zu-%zu/%zu\r\n", first, last,
                 bytes);
    put_head(r, ranged ? 206 : 200, ranged ? "Partial Content" : "OK", "application/octet-stream", size,
             more);
    put_model(r, version, piece, first, size);
    return ranged ? 206 : 200;
}

static int get_model(const request *r) { return get_piece(r, SF_PREVIEW_SPLATS); }
static int get_sh(const request *r) { return get_piece(r, SF_PREVIEW_SH); }

/* ---- Commands ---- */

static const struct {
    const char *name;
    sf_preview_command command;
} commands[] = {{"pause", SF_PREVIEW_PAUSE},
                {"go-on", SF_PREVIEW_GO_ON},
                {"save", SF_PREVIEW_SAVE},
                {"reset", SF_PREVIEW_RESET},
                {"lock-exposure", SF_PREVIEW_LOCK_EXPOSURE},
                {"unlock-exposure", SF_PREVIEW_UNLOCK_EXPOSURE}};

static int give(const request *r, sf_preview_command command) {
    switch (sf_store_give_command(r->server->store, command)) {
    case SF_OK:
        return answer(r, 204, "No Content", "text/plain", "", 0, "");
    case SF_ERR_TIMEOUT:
        return refuse(r, 503, "Service Unavailable", "the commands before it still wait\n");
    default:
        return refuse(r, 409, "Conflict", "there is nothing to command here\n");
    }
}

static int by_name(const request *r, const char *name) {
    for (size_t i = 0; name && i < sizeof commands / sizeof *commands; i++)
        if (is(name, commands[i].name)) return give(r, commands[i].command);
    return refuse(r, 400, "Bad Request", "no such command\n");
}

/* {"command": "save"}. A form of another site cannot send this type. */
static int post_command(const request *r) {
    char body[BODY + 1];
    const char *type = header(r, "Content-Type");
    long long size = r->info->content_length;
    if (!type || strncmp(type, "application/json", 16))
        return refuse(r, 415, "Unsupported Media Type", "a command is application/json\n");
    if (size < 1 || size > BODY) return refuse(r, 413, "Content Too Large", "a command is 1 to 256 bytes\n");
    for (long long at = 0; at < size;) {
        int got = mg_read(r->to, body + at, (size_t)(size - at));
        if (got <= 0) return refuse(r, 400, "Bad Request", "the command is cut off\n");
        at += got;
    }
    json_t *json = json_loadb(body, (size_t)size, 0, NULL);
    int code = by_name(r, json_string_value(json_object_get(json, "command")));
    json_decref(json);
    return code;
}

/* ---- Who asks ---- */

static int has_token(const request *r) {
    char given[SF_PREVIEW_MOST_TOKEN + 2];
    const char *query = r->info->query_string, *cookie = header(r, "Cookie"),
               *bearer = header(r, "Authorization");
    const char *token = r->server->token;
    if (!*token) return 1;
    if (query && mg_get_var(query, strlen(query), "token", given, sizeof given) > 0)
        return sf_preview_token_equal(token, given);
    if (bearer && !strncmp(bearer, "Bearer ", 7)) return sf_preview_token_equal(token, bearer + 7);
    return cookie && mg_get_cookie(cookie, r->server->cookie, given, sizeof given) > 0 &&
           sf_preview_token_equal(token, given);
}

/* 0, or the code of the answer that refused it. */
static int turned_away(const request *r) {
    const char *host = header(r, "Host");
    if (!sf_preview_host_allowed(host, r->server->machine, *r->server->token != 0))
        return refuse(r, 403, "Forbidden", "ask for this page by its address in figures, or as localhost\n");
    if (!sf_preview_origin_allowed(header(r, "Origin"), host))
        return refuse(r, 403, "Forbidden", "a page of another site asks for this\n");
    if (!has_token(r))
        return refuse(r, 403, "Forbidden",
                      "no token, or a wrong one: open the address that the program shows\n");
    return 0;
}

static const struct {
    const char *path;
    int (*get)(const request *r);
} resources[] = {{"/", get_page},
                 {"/status", get_status},
                 {"/history", get_history},
                 {"/camera.jpg", get_camera},
                 {"/render.jpg", get_render},
                 {"/model.splat", get_model},
                 {"/model.sh", get_sh}};

static int dispatch(const request *r) {
    const char *method = r->info->request_method, *path = r->info->local_uri;
    int reads = is(method, "GET") || is(method, "HEAD"), is_command = path && is(path, "/command");
    if (is_command && is(method, "POST")) return post_command(r);
    if (!reads || is_command)
        return answer(r, 405, "Method Not Allowed", "text/plain", "no such method here\n", 20,
                      is_command ? "Allow: POST\r\n" : "Allow: GET, HEAD\r\n");
    for (size_t i = 0; path && i < sizeof resources / sizeof *resources; i++)
        if (is(path, resources[i].path)) return resources[i].get(r);
    return refuse(r, 404, "Not Found", "no such thing here\n");
}

/* ---- The server ---- */

static int handle(connection *to) {
    const struct mg_request_info *info = mg_get_request_info(to);
    const request r = {.server = info->user_data, .to = to, .info = info};
    int code = turned_away(&r);
    return code ? code : dispatch(&r);
}

/* Clients that go away are no news; what keeps it from starting is told. */
static int complain(const connection *from, const char *message) {
    sf_preview_server *s = mg_get_user_data(mg_get_context(from));
    if (s && !s->listening && !*s->complaint) snprintf(s->complaint, sizeof s->complaint, "%s", message);
    return 1;
}

static struct mg_context *start(sf_preview_server *s) {
    char listen[64];
    snprintf(listen, sizeof listen, s->address.ipv6 ? "[%s]:%d" : "%s:%d", s->address.host, s->address.port);
    /* 8 requests at a time; more wait. */
    const char *options[] = {"listening_ports",
                             listen,
                             "num_threads",
                             "8",
                             "connection_queue",
                             "32",
                             "request_timeout_ms",
                             "5000",
                             "max_request_size",
                             "8192",
                             "enable_keep_alive",
                             "no",
                             "tcp_nodelay",
                             "1",
                             "linger_timeout_ms",
                             "1000",
                             NULL};
    struct mg_callbacks callbacks = {.begin_request = handle, .log_message = complain};
    return mg_start(&callbacks, s, options);
}

/* Cookies know no ports. */
static void name_cookie(sf_preview_server *s) {
    snprintf(s->cookie, sizeof s->cookie, "splatfit-%d", s->address.port);
}

sf_status sf_server_start(sf_preview_server *s) {
    struct mg_server_port port;
    sigset_t all, before;
    if (s->address.ipv6 && !mg_check_feature(MG_FEATURES_IPV6))
        return sf_fail(s->ctx, SF_ERR_UNSUPPORTED, "listen: [%s]:%d: this civetweb is built without IPv6",
                       s->address.host, s->address.port);
    name_cookie(s);
    /* Signals are the program's: the server's threads take none. */
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    struct mg_context *http = start(s);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (!http)
        return sf_fail(s->ctx, SF_ERR_IO, "listen: %s:%d: %s", s->address.host, s->address.port,
                       *s->complaint ? s->complaint : "the server does not start");
    if (mg_get_server_ports(http, 1, &port) == 1) s->address.port = port.port;
    name_cookie(s); /* nobody knows a free port yet */
    s->http = http;
    s->listening = 1;
    return SF_OK;
}

/* Between connections the server looks every two seconds whether it shall end: one more connection, once it
 * has been told, saves that time. */
static void *knock(void *server) {
    const sf_preview_server *s = server;
    const struct timespec first = {.tv_nsec = 20 * 1000 * 1000};
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)s->address.port)};
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    inet_pton(AF_INET, s->address.any ? "127.0.0.1" : s->address.host, &to.sin_addr);
    nanosleep(&first, NULL);
    if (fd < 0) return NULL;
    (void)!connect(fd, (const struct sockaddr *)&to, sizeof to);
    nanosleep(&first, NULL);
    close(fd);
    return NULL;
}

void sf_server_stop(sf_preview_server *s) {
    pthread_t thread;
    if (!s->http) return;
    int knocks = !s->address.ipv6 && !pthread_create(&thread, NULL, knock, s);
    mg_stop(s->http);
    if (knocks) pthread_join(thread, NULL);
    s->http = NULL;
}

#else

sf_status sf_server_start(sf_preview_server *s) {
    return sf_fail(s->ctx, SF_ERR_UNSUPPORTED, "preview: not built with civetweb");
}

void sf_server_stop(sf_preview_server *s) { (void)s; }

#endif
