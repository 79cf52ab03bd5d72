/* path_live.c - poses that arrive at a socket: a thread reads them as they come. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "../base/clock.h"
#include "path.h"

enum { DATAGRAM = 65536, WAITING = 8 };

/* 1. Bytes to lines */

static void end_line(sf_path *path, sf_path_sender *s, int64_t now_ns) {
    s->line[s->used] = 0;
    s->lines++;
    if (s->too_long) /* a line that is none, for the count and the report */
        sf_path_take_line(path, "line,too,long", s->lines, now_ns);
    else if (s->used)
        sf_path_take_line(path, s->line, s->lines, now_ns);
    s->used = 0;
    s->too_long = 0;
}

static void take_bytes(sf_path *path, sf_path_sender *s, const char *data, size_t size, int64_t now_ns) {
    for (size_t i = 0; i < size; i++) {
        if (data[i] == '\n')
            end_line(path, s, now_ns);
        else if (s->used + 1 < sizeof s->line)
            s->line[s->used++] = data[i] ? data[i] : '?';
        else
            s->too_long = 1;
    }
}

/* 2. The thread */

static void accept_sender(sf_path *path) {
    int fd = accept(path->socket, NULL, NULL);
    if (fd < 0) return;
    for (int i = 0; i < SF_PATH_SENDERS; i++)
        if (path->senders[i].fd < 0) {
            fcntl(fd, F_SETFL, O_NONBLOCK);
            path->senders[i] = (sf_path_sender){.fd = fd};
            return;
        }
    pthread_mutex_lock(&path->lock);
    snprintf(path->report, sizeof path->report, "there are %d senders already: one is turned away",
             SF_PATH_SENDERS);
    pthread_mutex_unlock(&path->lock);
    close(fd);
}

/* What there is of a sender; at its end it is let go. A datagram's end ends its last line. */
static void hear(sf_path *path, sf_path_sender *s) {
    ssize_t n = recv(s->fd, path->buffer, DATAGRAM, MSG_DONTWAIT);
    int64_t now = sf_clock_ns();
    if (n > 0) take_bytes(path, s, path->buffer, (size_t)n, now);
    if (n < 0 && (errno == EAGAIN || errno == EINTR || path->datagrams)) return;
    if ((n <= 0 || path->datagrams) && (s->used || s->too_long)) end_line(path, s, now);
    if (path->datagrams || n > 0) return;
    close(s->fd);
    s->fd = -1;
}

static void *listen_thread(void *arg) {
    sf_path *path = arg;
    for (;;) {
        struct pollfd fds[2 + SF_PATH_SENDERS] = {
            {.fd = path->stop[0], .events = POLLIN},
            {.fd = path->datagrams ? -1 : path->socket, .events = POLLIN}};
        for (int i = 0; i < SF_PATH_SENDERS; i++)
            fds[2 + i] = (struct pollfd){.fd = path->senders[i].fd, .events = POLLIN};
        if (poll(fds, 2 + SF_PATH_SENDERS, -1) < 0 && errno != EINTR) break;
        if (fds[0].revents) break;
        if (fds[1].revents) accept_sender(path);
        for (int i = 0; i < SF_PATH_SENDERS; i++)
            if (fds[2 + i].revents && path->senders[i].fd == fds[2 + i].fd) hear(path, &path->senders[i]);
    }
    return NULL;
}

/* 3. Sockets */

static sf_status io_fault(sf_path *path, const char *what) {
    return sf_fail(path->ctx, SF_ERR_IO, "%s: %s: %s", path->name, what, strerror(errno));
}

/* Whether a socket lies at the place that nobody listens at any more. */
static int is_left_over(const struct sockaddr_un *address) {
    struct stat stat;
    if (lstat(address->sun_path, &stat) != 0 || !S_ISSOCK(stat.st_mode)) return 0;
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    int refused = fd >= 0 && connect(fd, (const struct sockaddr *)address, sizeof *address) < 0 &&
                  errno == ECONNREFUSED;
    if (fd >= 0) close(fd);
    return refused;
}

static sf_status open_unix(sf_path *path, const char *where) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (!*where || strlen(where) >= sizeof address.sun_path)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: a socket's path has 1 to %zu bytes", path->name,
                       sizeof address.sun_path - 1);
    memcpy(address.sun_path, where, strlen(where));
    path->socket = socket(AF_UNIX, SOCK_STREAM, 0);
    if (path->socket < 0) return io_fault(path, "socket");
    if (is_left_over(&address)) unlink(where);
    if (bind(path->socket, (struct sockaddr *)&address, sizeof address) != 0) return io_fault(path, "bind");
    memcpy(path->socket_path, where, strlen(where));
    return listen(path->socket, WAITING) == 0 ? SF_OK : io_fault(path, "listen");
}

static sf_status open_udp(sf_path *path, const char *where) {
    char host[64], *end;
    struct sockaddr_in address = {.sin_family = AF_INET};
    socklen_t size = sizeof address;
    const char *colon = strrchr(where, ':');
    long port = colon && colon[1] >= '0' && colon[1] <= '9' ? strtol(colon + 1, &end, 10) : -1;
    if (port < 0 || port > 65535 || *end || (size_t)(colon - where) >= sizeof host)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: is not ADDRESS:PORT with a port of 0..65535",
                       path->name);
    snprintf(host, sizeof host, "%.*s", (int)(colon - where), where);
    address.sin_port = htons((uint16_t)port);
    if (inet_pton(AF_INET, host, &address.sin_addr) != 1)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: \"%s\" is not an IPv4 address", path->name, host);
    path->datagrams = 1;
    path->socket = socket(AF_INET, SOCK_DGRAM, 0);
    if (path->socket < 0) return io_fault(path, "socket");
    if (bind(path->socket, (struct sockaddr *)&address, sizeof address) != 0) return io_fault(path, "bind");
    if (getsockname(path->socket, (struct sockaddr *)&address, &size) == 0)
        snprintf(path->name, sizeof path->name, "udp:%s:%u", host, (unsigned)ntohs(address.sin_port));
    path->senders[0] = (sf_path_sender){.fd = path->socket};
    return SF_OK;
}

sf_status sf_path_listen(sf_path *path, const char *scheme, const char *where) {
    sf_status status = strcmp(scheme, "udp") == 0 ? open_udp(path, where) : open_unix(path, where);
    if (status != SF_OK) return status;
    path->live = 1;
    if (!(path->buffer = sf_alloc(path->ctx, DATAGRAM, 1))) return SF_ERR_MEMORY;
    if (pipe(path->stop) != 0) return io_fault(path, "pipe");
    for (int i = 0; i < 2; i++) fcntl(path->stop[i], F_SETFD, FD_CLOEXEC);
    fcntl(path->socket, F_SETFD, FD_CLOEXEC);
    if (pthread_create(&path->thread, NULL, listen_thread, path) != 0)
        return sf_fail(path->ctx, SF_ERR_MEMORY, "%s: no thread to listen", path->name);
    path->has_thread = 1;
    return SF_OK;
}

static void close_if_open(int *fd) {
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

void sf_path_deafen(sf_path *path) {
    close_if_open(&path->stop[1]); /* its other end becomes readable */
    if (path->has_thread) pthread_join(path->thread, NULL);
    for (int i = 0; i < SF_PATH_SENDERS; i++)
        if (!path->datagrams) close_if_open(&path->senders[i].fd);
    close_if_open(&path->stop[0]);
    close_if_open(&path->socket);
    if (path->socket_path[0]) unlink(path->socket_path);
}
