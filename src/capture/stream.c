/* stream.c - bytes from a pipe or file, with bounded waits. */
#include "stream.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#include "../base/clock.h"

/* A wait is looked at anew after so long, whoever may have stopped it. */
enum { TURN_MS = 1000 };

static int turn_ms(int64_t deadline_ns) {
    int64_t left = (deadline_ns - sf_clock_ns() + 999999) / 1000000;
    return left < 0 ? 0 : left < TURN_MS ? (int)left : TURN_MS;
}

static sf_status io_failure(sf_stream *s) {
    s->error = errno;
    return SF_ERR_IO;
}

static sf_status wait_for_bytes(sf_stream *s, int64_t deadline_ns) {
    struct pollfd fds[2] = {{.fd = s->fd, .events = POLLIN}, {.fd = s->stop, .events = POLLIN}};
    for (;;) {
        int turn = turn_ms(deadline_ns), ready = poll(fds, 2, turn);
        if (ready < 0 && errno != EINTR) return io_failure(s);
        if (ready > 0) return fds[1].revents ? SF_ERR_CANCELLED : SF_OK;
        if (sf_clock_ns() >= deadline_ns) return SF_ERR_TIMEOUT;
    }
}

/* Up to `room` bytes, straight from the file. */
static sf_status read_some(sf_stream *s, int64_t deadline_ns, uint8_t *data, size_t room, size_t *got) {
    for (;;) {
        sf_status status = wait_for_bytes(s, deadline_ns);
        if (status != SF_OK) return status;
        ssize_t n = read(s->fd, data, room);
        if (n > 0) {
            *got = (size_t)n;
            return SF_OK;
        }
        if (n == 0) return SF_ERR_END;
        if (errno != EINTR && errno != EAGAIN) return io_failure(s);
    }
}

sf_status sf_stream_peek(sf_stream *s, int64_t deadline_ns, const uint8_t **data, size_t *size) {
    if (s->at == s->end) {
        s->at = s->end = 0;
        sf_status status = read_some(s, deadline_ns, s->buffer, SF_STREAM_BUFFER, &s->end);
        if (status != SF_OK) return status;
    }
    *data = s->buffer + s->at;
    *size = s->end - s->at;
    return SF_OK;
}

void sf_stream_take(sf_stream *s, size_t size) {
    s->at += size;
    s->offset += size;
}

/* Large reads go past the buffer. */
sf_status sf_stream_read(sf_stream *s, int64_t deadline_ns, uint8_t *data, size_t size, size_t *got) {
    *got = 0;
    while (*got < size) {
        size_t room = size - *got, n = 0;
        const uint8_t *bytes;
        int direct = s->at == s->end && room >= SF_STREAM_BUFFER;
        sf_status status = direct ? read_some(s, deadline_ns, data + *got, room, &n)
                                  : sf_stream_peek(s, deadline_ns, &bytes, &n);
        if (status != SF_OK) return status;
        if (direct) {
            s->offset += n;
        } else {
            if (n > room) n = room;
            memcpy(data + *got, bytes, n);
            sf_stream_take(s, n);
        }
        *got += n;
    }
    return SF_OK;
}

sf_status sf_stream_line(sf_stream *s, int64_t deadline_ns, char *line, size_t room) {
    size_t used = 0;
    line[0] = 0;
    for (;;) {
        const uint8_t *bytes;
        size_t size;
        sf_status status = sf_stream_peek(s, deadline_ns, &bytes, &size);
        if (status != SF_OK) return status;
        uint8_t byte = bytes[0];
        sf_stream_take(s, 1);
        if (byte == '\n') return SF_OK;
        if (used + 1 == room || !byte) return SF_ERR_FORMAT;
        line[used++] = (char)byte;
        line[used] = 0;
    }
}
