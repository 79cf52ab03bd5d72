/* dma_heaps.c - whether this system gives memory that cameras can share. */
#include "dma_heaps.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { PATH = 256 };

/* 0, or why it cannot be opened. */
static int trouble_with(const char *path) {
    int fd = open(path, O_RDWR | O_CLOEXEC);
    if (fd < 0) return errno;
    close(fd);
    return 0;
}

/* Where a group may open it, not root's, that is the way; otherwise a rule is needed. */
static void explain_refusal(const char *path, int error, char *text, size_t bytes) {
    struct stat s;
    const unsigned both = S_IRGRP | S_IWGRP;
    const char *what = "";
    if (error == EACCES && stat(path, &s) == 0)
        what = s.st_gid && (s.st_mode & both) == both
                   ? "; add yourself to its group (ls -l shows it), and log in again"
                   : "; a rule of udev lets a group open it: SUBSYSTEM==\"dma_heap\", GROUP=\"video\", "
                     "MODE=\"0660\"";
    snprintf(text, bytes, "no DMA heap: %s: %s%s", path, strerror(error), what);
}

void sf_dma_heaps_explain(const char *dev, char *text, size_t bytes) {
    static const char *const names[] = {"dma_heap/linux,cma", "dma_heap/reserved", "dma_heap/system",
                                        "udmabuf"};
    char path[PATH], refused[PATH] = "";
    int error = 0;
    *text = 0;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        snprintf(path, sizeof path, "%s/%s", dev, names[i]);
        int trouble = trouble_with(path);
        if (!trouble) return;
        if (trouble == ENOENT || *refused) continue;
        error = trouble;
        memcpy(refused, path, sizeof refused);
    }
    if (*refused)
        explain_refusal(refused, error, text, bytes);
    else
        snprintf(
            text, bytes,
            "no DMA heap: %s/dma_heap and %s/udmabuf are missing; load the module udmabuf (sudo modprobe "
            "udmabuf), or use a kernel with CONFIG_DMABUF_HEAPS_SYSTEM or CONFIG_UDMABUF",
            dev, dev);
}
