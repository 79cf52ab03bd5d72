/* temporary.c - see temporary.h.
 *
 * ".NAME.PROCESS.NUMBER.tmp" beside the target NAME. A process number is used again, and means nothing on
 * another machine that shares the folder: whether the writer lives is told by a lock, which ends with it
 * however it ends.
 */
#include "temporary.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    TRIES = 100,     /* names that are in use are stepped over */
    NAME_BYTES = 200 /* of the target's name: the rest of the 255 is for what is added */
};

static const char *name_in(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* Whether the file is locked and still has its name: who clears up may have come between. Where nothing can
 * be locked nothing is cleared up either. */
static int is_ours(int fd) {
    struct stat st;
    if (flock(fd, LOCK_EX | LOCK_NB) && errno == EWOULDBLOCK) return 0;
    return !fstat(fd, &st) && st.st_nlink > 0;
}

int sf_temporary_open(const char *path, mode_t mode, char *name, size_t size, int *lock) {
    int fd = -1, error = EEXIST;
    *lock = -1;
    for (int i = 0; i < TRIES && fd < 0 && error == EEXIST; i++) {
        snprintf(name, size, "%.*s.%.*s.%ld.%d.tmp", (int)(name_in(path) - path), path, NAME_BYTES,
                 name_in(path), (long)getpid(), i);
        fd = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
        error = errno;
        if (fd < 0 || is_ours(fd)) continue;
        close(fd);
        fd = -1, error = EEXIST;
    }
    if (fd < 0) {
        errno = error;
        return -1;
    }
    *lock = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    if (*lock >= 0) return fd;
    error = errno;
    unlink(name);
    close(fd);
    errno = error;
    return -1;
}

/* Whether `entry` is a temporary name of the target. */
static int is_temporary(const char *entry, const char *target) {
    char ending[8] = "";
    size_t n = strlen(target) < NAME_BYTES ? strlen(target) : NAME_BYTES;
    long process;
    int number, end = 0;
    if (entry[0] != '.' || strncmp(entry + 1, target, n)) return 0;
    if (sscanf(entry + 1 + n, ".%ld.%d.%3s%n", &process, &number, ending, &end) != 3) return 0;
    return !strcmp(ending, "tmp") && !entry[1 + n + (size_t)end];
}

/* A lock that can be had is one that nobody holds. */
static void remove_if_dead(int folder, const char *entry) {
    int fd = openat(folder, entry, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) return;
    if (!flock(fd, LOCK_EX | LOCK_NB)) unlinkat(folder, entry, 0);
    close(fd);
}

void sf_temporary_clear(const char *path) {
    const char *target = name_in(path);
    char folder[4096] = ".";
    if (target - path >= (long)sizeof folder) return;
    if (target > path) snprintf(folder, sizeof folder, "%.*s", (int)(target - path), path);
    DIR *d = opendir(folder);
    if (!d) return;
    for (struct dirent *e; (e = readdir(d));)
        if (is_temporary(e->d_name, target)) remove_if_dead(dirfd(d), e->d_name);
    closedir(d);
}
