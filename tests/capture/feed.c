/* feed.c - feed WIDTHxHEIGHT FPS SECONDS: writes YUV4MPEG2 (4:2:0) to standard output in real time, each
 * frame begun by its number in 8 bytes (little-endian). At the end says on standard error how many it wrote.
 */
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void sleep_until(int64_t time_ns) {
    struct timespec t = {(time_t)(time_ns / 1000000000), (long)(time_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL)) {
    }
}

static void paint(uint8_t *frame, size_t size, uint64_t number) {
    for (size_t i = 0; i < size; i++) frame[i] = (uint8_t)(number + i % 97);
    for (size_t i = 0; i < 8; i++) frame[i] = (uint8_t)(number >> (8 * i));
}

/* 0: somebody stopped reading. */
static int write_frame(const uint8_t *frame, size_t size) {
    return fputs("FRAME\n", stdout) >= 0 && fwrite(frame, 1, size, stdout) == size && !fflush(stdout);
}

int main(int argc, char **argv) {
    int width, height;
    double fps = argc > 2 ? atof(argv[2]) : 0, seconds = argc > 3 ? atof(argv[3]) : 0;
    if (argc != 4 || sscanf(argv[1], "%dx%d", &width, &height) != 2 || width < 8 || width % 2 || height < 2 ||
        height % 2 || !(fps > 0) || !(seconds > 0)) {
        fprintf(stderr, "feed: WIDTHxHEIGHT (even) FPS SECONDS\n");
        return 2;
    }
    size_t size = (size_t)width * (size_t)height * 3 / 2;
    uint8_t *frame = malloc(size);
    uint64_t frames = (uint64_t)(fps * seconds + 0.5), sent = 0;
    int64_t began = now_ns();
    if (!frame) return 1;
    printf("YUV4MPEG2 W%d H%d F%d:1000 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n", width, height,
           (int)(1000 * fps));
    for (; sent < frames; sent++) {
        sleep_until(began + (int64_t)((double)sent * 1e9 / fps));
        paint(frame, size, sent);
        if (!write_frame(frame, size)) break;
    }
    fprintf(stderr, "sent %" PRIu64 "\n", sent);
    free(frame);
    return sent < frames;
}
