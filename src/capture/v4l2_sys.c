/* v4l2_sys.c - the operating system's calls for V4L2. */
#ifdef __linux__
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <time.h>
#include <unistd.h>

#include "v4l2_device.h"

static int open_node(void *user, const char *path) {
    (void)user;
    return open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
}

static int close_node(void *user, int fd) {
    (void)user;
    return close(fd);
}

static int control(void *user, int fd, unsigned long request, void *arg) {
    (void)user;
    return ioctl(fd, request, arg);
}

static int wait_for_events(void *user, int fd, int timeout_ms, int *events) {
    struct pollfd p = {.fd = fd, .events = POLLIN};
    (void)user;
    int ready = poll(&p, 1, timeout_ms);
    *events = ready > 0 ? p.revents : 0;
    return ready;
}

static void *map(void *user, int fd, size_t offset, size_t length) {
    (void)user;
    void *memory = mmap(NULL, length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, (off_t)offset);
    return memory == MAP_FAILED ? NULL : memory;
}

static int unmap(void *user, void *memory, size_t length) {
    (void)user;
    return munmap(memory, length);
}

static int by_number(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

static size_t list(void *user, int *numbers, size_t most) {
    (void)user;
    DIR *folder = opendir("/dev");
    size_t count = 0;
    if (!folder) return 0;
    for (struct dirent *entry; count < most && (entry = readdir(folder));) {
        const char *digits = entry->d_name + strlen("video");
        if (strncmp(entry->d_name, "video", strlen("video")) != 0 || !*digits || strlen(digits) > 6 ||
            strspn(digits, "0123456789") != strlen(digits))
            continue;
        numbers[count++] = atoi(digits);
    }
    closedir(folder);
    qsort(numbers, count, sizeof *numbers, by_number);
    return count;
}

/* The first line of a file about the node in sysfs, "" where there is none. */
static void read_about(int fd, const char *name, char *text, size_t size) {
    char path[96];
    struct stat st;
    *text = 0;
    if (fstat(fd, &st) || !S_ISCHR(st.st_mode)) return;
    snprintf(path, sizeof path, "/sys/dev/char/%u:%u/%s", major(st.st_rdev), minor(st.st_rdev), name);
    FILE *file = fopen(path, "re");
    if (!file) return;
    if (!fgets(text, (int)size, file)) *text = 0;
    fclose(file);
    text[strcspn(text, "\n")] = 0;
}

static void identify(void *user, int fd, char *serial, size_t size, int *index) {
    char number[16];
    (void)user;
    read_about(fd, "device/../serial", serial, size); /* "device" is the USB interface, above it the device */
    read_about(fd, "index", number, sizeof number);
    *index = atoi(number);
}

static int64_t now_ns(void *user) {
    struct timespec t;
    (void)user;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void sleep_ms(void *user, int ms) {
    (void)user;
    nanosleep(&(struct timespec){ms / 1000, (long)(ms % 1000) * 1000000}, NULL);
}

const sf_v4l2_sys sf_v4l2_system = {.open = open_node,
                                    .close = close_node,
                                    .ioctl = control,
                                    .poll = wait_for_events,
                                    .map = map,
                                    .unmap = unmap,
                                    .list = list,
                                    .identify = identify,
                                    .now_ns = now_ns,
                                    .sleep_ms = sleep_ms};
#endif
