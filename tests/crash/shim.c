/* shim.c - loaded before a program: its disk fills up, or its memory ends, at a call of one's choice.
 *
 * Calls that take room on a disk are counted: opening a file to write, writing, syncing, closing and renaming
 * it, making a folder, reserving room; of regular files alone, so that what goes to a terminal or a pipe is
 * not touched. And so are allocations, from the program's first call of signal() on: what loads the libraries
 * has no way to fail.
 *
 * SHIM_DISK=N: the N-th such call fails with ENOSPC (from 1).
 *
 * SHIM_MODE=on: and so do all that follow, but for renaming and closing: the disk stays full, the first write
 * takes half of what it is given.
 *
 * SHIM_MEMORY=N: the N-th allocation fails.
 *
 * SHIM_COUNT=F: writes both counts to the file F in the end.
 */
#undef _FILE_OFFSET_BITS /* a call has two names, and both are defined here */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define SHOWN __attribute__((visibility("default")))

static atomic_long disk_calls, allocations;
static long disk_at, memory_at;
static int stays_full;
static atomic_int armed;

static long number_of(const char *name) {
    const char *text = getenv(name);
    return text ? strtol(text, NULL, 10) : 0;
}

__attribute__((constructor)) static void start(void) {
    disk_at = number_of("SHIM_DISK");
    memory_at = number_of("SHIM_MEMORY");
    const char *mode = getenv("SHIM_MODE");
    stays_full = mode && !strcmp(mode, "on");
}

__attribute__((destructor)) static void end(void) {
    char line[64];
    const char *path = getenv("SHIM_COUNT");
    int n = snprintf(line, sizeof line, "%ld %ld\n", disk_calls, allocations);
    int fd = path ? (int)syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_TRUNC, 0600) : -1;
    if (fd < 0 || syscall(SYS_write, fd, line, (size_t)n) != n) return;
    syscall(SYS_close, fd);
}

static void *next(const char *name) { return dlsym(RTLD_NEXT, name); }

/* A function pointer of the next library's. */
#define NEXT(type, name, ...)                                                                                \
    type (*next_##name)(__VA_ARGS__);                                                                        \
    *(void **)&next_##name = next(#name)

/* Whether this call fails; takes_room: it does on a disk that stays full. */
static int fails(int takes_room) {
    long call = ++disk_calls;
    if (!disk_at || !(call == disk_at || (stays_full && takes_room && call > disk_at))) return 0;
    errno = ENOSPC;
    return 1;
}

static int is_written_file(int fd) {
    struct stat st;
    int flags = fcntl(fd, F_GETFL);
    return fd > 2 && flags >= 0 && (flags & O_ACCMODE) != O_RDONLY && !fstat(fd, &st) && S_ISREG(st.st_mode);
}

/* What opens a file. */

static int open_file(const char *path, int flags, va_list arguments) {
    mode_t mode = flags & O_CREAT ? va_arg(arguments, mode_t) : 0;
    if (flags & O_CREAT && fails(1)) return -1;
    return (int)syscall(SYS_openat, AT_FDCWD, path, flags | O_LARGEFILE, mode);
}

#define OPENS(name)                                                                                          \
    SHOWN int name(const char *path, int flags, ...);                                                        \
    int name(const char *path, int flags, ...) {                                                             \
        va_list arguments;                                                                                   \
        va_start(arguments, flags);                                                                          \
        int fd = open_file(path, flags, arguments);                                                          \
        va_end(arguments);                                                                                   \
        return fd;                                                                                           \
    }
OPENS(open)
OPENS(open64)

/* What takes room. */

SHOWN ssize_t write(int fd, const void *data, size_t size) {
    if (!is_written_file(fd)) return syscall(SYS_write, fd, data, size);
    int first = disk_calls + 1 == disk_at && stays_full && size > 1;
    if (first) {
        disk_calls++;
        return syscall(SYS_write, fd, data, size / 2);
    }
    return fails(1) ? -1 : syscall(SYS_write, fd, data, size);
}

SHOWN int fsync(int fd) {
    if (!is_written_file(fd)) return (int)syscall(SYS_fsync, fd);
    return fails(1) ? -1 : (int)syscall(SYS_fsync, fd);
}

static int allocate(int fd, off_t at, off_t size) {
    if (fails(1)) return ENOSPC;
    return syscall(SYS_fallocate, fd, 0, at, size) ? errno : 0;
}
SHOWN int posix_fallocate(int fd, off_t at, off_t size) { return allocate(fd, at, size); }
SHOWN int posix_fallocate64(int fd, off_t at, off_t size) { return allocate(fd, at, size); }

SHOWN int mkdir(const char *path, mode_t mode) {
    return fails(1) ? -1 : (int)syscall(SYS_mkdirat, AT_FDCWD, path, mode);
}

/* A stream's buffer goes out behind the shim's back: here. */
SHOWN int fflush(FILE *stream) {
    NEXT(int, fflush, FILE *);
    if (!stream || !is_written_file(fileno(stream))) return next_fflush(stream);
    return fails(1) ? EOF : next_fflush(stream);
}

SHOWN int fputs(const char *text, FILE *stream) {
    NEXT(int, fputs, const char *, FILE *);
    if (!is_written_file(fileno(stream))) return next_fputs(text, stream);
    return fails(1) ? EOF : next_fputs(text, stream);
}

/* What takes none, and may report what was not written before. */

SHOWN int rename(const char *from, const char *to) {
    return fails(0) ? -1 : (int)syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to);
}

SHOWN int close(int fd) {
    int failing = is_written_file(fd) && fails(0), result = (int)syscall(SYS_close, fd);
    if (failing) errno = ENOSPC;
    return failing ? -1 : result;
}

SHOWN int fclose(FILE *stream) {
    NEXT(int, fclose, FILE *);
    int failing = is_written_file(fileno(stream)) && fails(0), result = next_fclose(stream);
    if (failing) errno = ENOSPC;
    return failing ? EOF : result;
}

/* Memory. */

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *block, size_t size);

/* What signal() is where POSIX alone is asked for. */
SHOWN void (*__sysv_signal(int number, void (*handler)(int)))(int) {
    struct sigaction action = {.sa_handler = handler}, before;
    armed = 1;
    return sigaction(number, &action, &before) ? SIG_ERR : before.sa_handler;
}

static int has_ended(void) {
    if (!armed || ++allocations != memory_at) return 0;
    errno = ENOMEM;
    return 1;
}

SHOWN void *malloc(size_t size) { return has_ended() ? NULL : __libc_malloc(size); }
SHOWN void *calloc(size_t count, size_t size) { return has_ended() ? NULL : __libc_calloc(count, size); }
SHOWN void *realloc(void *block, size_t size) { return has_ended() ? NULL : __libc_realloc(block, size); }
