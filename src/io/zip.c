/* zip.c - see zip.h.
 *
 * What is unpacked is read at once and removed: a scene holds its pictures. Links are not made, and of other
 * files than a project's nothing is written.
 */
#include "zip.h"

#include "../base/file.h"

#include <string.h>

int sf_zip_is(const char *path) {
    uint8_t start[4];
    if (sf_read_start(path, start, sizeof start) < sizeof start) return 0;
    return !memcmp(start, "PK\3\4", 4) || !memcmp(start, "PK\5\6", 4);
}

#ifdef SF_HAVE_LIBZIP

#include "dataset.h"
#include "no_project.h"
#include "paths.h"
#include "picture_names.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <strings.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include <zip.h>

enum {
    MAX_ENTRIES = 1 << 20,
    MAX_NAME = 1024,
    BLOCK = 1 << 16,
    PACKED_A_BYTE = 1032, /* the most that deflate packs into one */
    LEAST_ALLOWED = 1 << 24,
    MOST_TIMES = 100, /* the archive's size, where that is more */
    UNIX = 3          /* the system of an entry's attributes */
};

/* A folder is FOLDER_FRONT and six letters of mkdtemp's. The lock in it ends with who has made it, however
 * that ends: a folder whose lock nobody holds was left behind. */
#define FOLDER_FRONT "splatfit-zip-"
#define LOCK_NAME    ".splatfit-lock"

typedef struct archive {
    sf_context *ctx;
    const char *path;
    zip_t *zip;
    sf_unpacked to;
    uint64_t size; /* of the file */
} archive;

static sf_status entry_fail(const archive *a, const char *name, sf_status status, const char *fault) {
    return sf_fail(a->ctx, status, "%s: %s: %s", a->path, name, fault);
}

/* Which entries. */

/* Pictures, models, lists. Files of macOS and of editors begin with a dot or lie in a separate folder.
 */
static int is_wanted(const char *name) {
    static const char *const endings[] = {".png", ".jpg", ".jpeg", ".json", ".bin", ".txt", ".ply"};
    const char *slash = strrchr(name, '/'), *last = slash ? slash + 1 : name, *dot = strrchr(last, '.');
    if (!strncmp(name, "__MACOSX/", 9) || !dot || *last == '.') return 0;
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (!strcasecmp(dot, endings[i])) return 1;
    return 0;
}

static int is_link(const archive *a, zip_uint64_t index) {
    zip_uint8_t system = 0;
    zip_uint32_t attributes = 0;
    if (zip_file_get_external_attributes(a->zip, index, 0, &system, &attributes)) return 0;
    return system == UNIX && (attributes >> 16 & S_IFMT) == S_IFLNK;
}

/* The name with / for \, which some tools write; SF_ERR_FORMAT: it leads out of the folder, or is not a name.
 */
static sf_status take_name(const archive *a, const char *from, char name[MAX_NAME]) {
    if (!from || strlen(from) >= MAX_NAME)
        return entry_fail(a, "a name", SF_ERR_FORMAT, "is missing or too long");
    strcpy(name, from);
    for (char *c = name; *c; c++)
        if (*c == '\\') *c = '/';
    if (!sf_name_stays_inside(name)) return entry_fail(a, from, SF_ERR_FORMAT, "leads out of the archive");
    return SF_OK;
}

/* *wanted: whether the entry is to be unpacked, under `name`. */
static sf_status look_at(const archive *a, zip_uint64_t index, zip_stat_t *st, char name[MAX_NAME],
                         int *wanted) {
    const zip_uint64_t needed = ZIP_STAT_NAME | ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE;
    *wanted = 0;
    if (zip_stat_index(a->zip, index, 0, st) || (st->valid & needed) != needed)
        return sf_fail(a->ctx, SF_ERR_FORMAT, "%s: entry %llu: %s", a->path, (unsigned long long)index,
                       zip_strerror(a->zip));
    sf_status status = take_name(a, st->name, name);
    if (status || name[strlen(name) - 1] == '/' || !is_wanted(name) || is_link(a, index)) return status;
    if ((st->valid & ZIP_STAT_ENCRYPTION_METHOD) && st->encryption_method != ZIP_EM_NONE)
        return entry_fail(a, name, SF_ERR_UNSUPPORTED, "is encrypted");
    if (st->size > st->comp_size * PACKED_A_BYTE + PACKED_A_BYTE)
        return entry_fail(a, name, SF_ERR_FORMAT, "size: is more than its packed bytes can hold");
    *wanted = 1;
    return SF_OK;
}

/* Sums may not overflow: each size is at most 1,032 times what the file has. */
static sf_status check_sizes(const archive *a, uint64_t unpacked, uint64_t packed) {
    const double mega = 1048576;
    struct statvfs disk;
    uint64_t most = MOST_TIMES * a->size > LEAST_ALLOWED ? MOST_TIMES * a->size : LEAST_ALLOWED;
    if (packed > a->size)
        return sf_fail(a->ctx, SF_ERR_FORMAT, "%s: size: its entries take more than the file has", a->path);
    if (unpacked > most)
        return sf_fail(a->ctx, SF_ERR_FORMAT, "%s: size: %.0f MB unpacked are more than %d times the file",
                       a->path, (double)unpacked / mega, MOST_TIMES);
    if (!statvfs(a->to.folder, &disk) &&
        (double)unpacked > 0.95 * (double)disk.f_bavail * (double)disk.f_frsize)
        return sf_fail(a->ctx, SF_ERR_IO,
                       "%s: %.0f MB unpacked: %s has no room for them (TMPDIR names another)", a->path,
                       (double)unpacked / mega, a->to.folder);
    return SF_OK;
}

static sf_status check_all(const archive *a, zip_uint64_t count) {
    uint64_t unpacked = 0, packed = 0;
    size_t found = 0, pictures = 0;
    char video[MAX_NAME] = "";
    for (zip_uint64_t i = 0; i < count; i++) {
        zip_stat_t st;
        char name[MAX_NAME];
        int wanted;
        sf_status status = look_at(a, i, &st, name, &wanted);
        if (status) return status;
        if (!*video && sf_is_video_name(name)) strcpy(video, name);
        if (!wanted) continue;
        pictures += sf_is_picture_name(name) != 0;
        if (st.comp_size > a->size) return check_sizes(a, 0, st.comp_size);
        unpacked += st.size;
        packed += st.comp_size;
        found++;
    }
    if (*video && !pictures) return sf_no_project_of_archive(a->ctx, a->path, video);
    if (!found) return sf_fail(a->ctx, SF_ERR_FORMAT, "%s: holds no picture and no model", a->path);
    return check_sizes(a, unpacked, packed);
}

/* Unpacking. */

static sf_status write_entry(const archive *a, zip_file_t *from, const char *name, uint64_t size, int to,
                             uint8_t *block) {
    uint64_t done = 0;
    for (;;) {
        zip_int64_t got = zip_fread(from, block, BLOCK);
        if (got < 0) return entry_fail(a, name, SF_ERR_FORMAT, zip_error_strerror(zip_file_get_error(from)));
        if (!got) break;
        done += (uint64_t)got;
        if (done > size) break;
        if (atomic_load(&a->ctx->loads_cancelled)) return sf_load_cancelled(a->ctx, a->path);
        for (zip_int64_t at = 0; at < got;) {
            ssize_t put = write(to, block + at, (size_t)(got - at));
            if (put < 0 && errno != EINTR) return entry_fail(a, name, SF_ERR_IO, strerror(errno));
            if (put > 0) at += put;
        }
    }
    return done == size ? SF_OK : entry_fail(a, name, SF_ERR_FORMAT, "size: is not what the archive says");
}

static sf_status make_folders(const archive *a, char *path, const char *name) {
    for (char *c = path + strlen(path) - strlen(name); *c; c++) {
        if (*c != '/') continue;
        *c = 0;
        int failed = mkdir(path, 0700) && errno != EEXIST;
        *c = '/';
        if (failed) return entry_fail(a, name, SF_ERR_IO, strerror(errno));
    }
    return SF_OK;
}

static sf_status unpack_to(const archive *a, zip_uint64_t index, const zip_stat_t *st, const char *name,
                           char *path) {
    sf_status status = make_folders(a, path, name);
    if (status) return status;
    int to = open(path, O_WRONLY | O_CREAT | O_EXCL, 0600);
    if (to < 0)
        return entry_fail(a, name, errno == EEXIST ? SF_ERR_FORMAT : SF_ERR_IO,
                          errno == EEXIST ? "appears twice" : strerror(errno));
    zip_file_t *from = zip_fopen_index(a->zip, index, 0);
    uint8_t *block = sf_alloc(a->ctx, BLOCK, 1);
    if (!from)
        status = entry_fail(a, name, SF_ERR_FORMAT, zip_strerror(a->zip));
    else
        status = block ? write_entry(a, from, name, st->size, to, block) : SF_ERR_MEMORY;
    if (from) zip_fclose(from);
    sf_free(a->ctx, block);
    if (close(to) && !status) status = entry_fail(a, name, SF_ERR_IO, strerror(errno));
    return status;
}

static sf_status unpack_one(const archive *a, const char *project, zip_uint64_t index) {
    zip_stat_t st;
    char name[MAX_NAME];
    int wanted;
    sf_status status = look_at(a, index, &st, name, &wanted);
    if (status || !wanted) return status;
    char *path = sf_path_join(a->ctx, project, name);
    status = path ? unpack_to(a, index, &st, name, path) : SF_ERR_MEMORY;
    sf_free(a->ctx, path);
    return status;
}

static sf_status unpack_all(const archive *a) {
    const char *project = a->to.project;
    zip_int64_t count = zip_get_num_entries(a->zip, 0);
    if (count > MAX_ENTRIES)
        return sf_fail(a->ctx, SF_ERR_FORMAT, "%s: %lld entries are more than %d", a->path, (long long)count,
                       MAX_ENTRIES);
    sf_status status = check_all(a, (zip_uint64_t)count);
    if (!status && mkdir(project, 0700)) status = entry_fail(a, project, SF_ERR_IO, strerror(errno));
    for (zip_int64_t i = 0; !status && i < count; i++) status = unpack_one(a, project, (zip_uint64_t)i);
    return status;
}

/* Removing. */

/* What follows allocates nothing: it must work where memory is short. */

static int is_kept(const char *name) {
    return !strcmp(name, ".") || !strcmp(name, "..") || !strcmp(name, LOCK_NAME);
}

static int open_folder(int where, const char *name) {
    return openat(where, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

/* All in an open folder, which is closed, but the lock. */
static void empty_folder(int fd) {
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *e;
    while (folder && (e = readdir(folder))) {
        if (is_kept(e->d_name) || !unlinkat(fd, e->d_name, 0)) continue;
        empty_folder(open_folder(fd, e->d_name));
        unlinkat(fd, e->d_name, AT_REMOVEDIR);
    }
    if (folder)
        closedir(folder);
    else if (fd >= 0)
        close(fd);
}

/* The lock goes last: what is left by who is killed here is still known as ours. */
static void remove_folder(int where, const char *name) {
    int fd = open_folder(where, name);
    if (fd < 0) return;
    int again = dup(fd);
    empty_folder(again);
    unlinkat(fd, LOCK_NAME, 0);
    close(fd);
    unlinkat(where, name, AT_REMOVEDIR);
}

void sf_zip_remove(sf_context *ctx, sf_unpacked *u) {
    if (u->folder) remove_folder(AT_FDCWD, u->folder);
    if (u->lock >= 0) close(u->lock);
    sf_free(ctx, u->folder);
    sf_free(ctx, u->project);
    *u = (sf_unpacked){.lock = -1};
}

/* What was left behind. */

static int is_folder_name(const char *name) {
    size_t front = sizeof FOLDER_FRONT - 1;
    return !strncmp(name, FOLDER_FRONT, front) && strlen(name) == front + 6;
}

/* A folder without a lock is empty, for it is new or all but removed; a lock that can be had is nobody's. */
static void remove_if_dead(int where, const char *name) {
    struct stat st;
    int folder = open_folder(where, name);
    if (folder < 0) return;
    if (!fstat(folder, &st) && st.st_uid == geteuid() && unlinkat(where, name, AT_REMOVEDIR)) {
        int lock = openat(folder, LOCK_NAME, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
        if (lock >= 0 && !flock(lock, LOCK_EX | LOCK_NB)) remove_folder(where, name);
        if (lock >= 0) close(lock);
    }
    close(folder);
}

static void clear(const char *where) {
    DIR *folder = opendir(where);
    const struct dirent *e;
    while (folder && (e = readdir(folder)))
        if (is_folder_name(e->d_name)) remove_if_dead(dirfd(folder), e->d_name);
    if (folder) closedir(folder);
}

/* A folder of our own. */

/* Whether the folder is locked and still there: who clears up may have come between. Where nothing can be
 * locked nothing is cleared up either. */
static int lock_folder(sf_unpacked *to) {
    struct stat st;
    int folder = open_folder(AT_FDCWD, to->folder);
    if (folder < 0) return 0;
    to->lock = openat(folder, LOCK_NAME, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    close(folder);
    if (to->lock < 0) return 0;
    if ((!flock(to->lock, LOCK_EX | LOCK_NB) || errno != EWOULDBLOCK) && !fstat(to->lock, &st) && st.st_nlink)
        return 1;
    close(to->lock);
    to->lock = -1;
    return 0;
}

static sf_status try_folder(archive *a, const char *where) {
    a->to.folder = sf_path_join(a->ctx, where, FOLDER_FRONT "XXXXXX");
    if (!a->to.folder) return SF_ERR_MEMORY;
    int made = mkdtemp(a->to.folder) != NULL;
    if (made && lock_folder(&a->to)) return SF_OK;
    sf_fail(a->ctx, SF_ERR_IO, "%s: cannot be unpacked to %s: %s", a->path, a->to.folder, strerror(errno));
    if (made) remove_folder(AT_FDCWD, a->to.folder);
    return SF_ERR_IO;
}

static sf_status make_folder(archive *a) {
    enum { TRIES = 10 };
    const char *named = getenv("TMPDIR"), *where = named && *named ? named : "/tmp";
    sf_status status = SF_ERR_IO;
    clear(where);
    for (int i = 0; i < TRIES && status == SF_ERR_IO; i++) {
        status = try_folder(a, where);
        if (!status) return SF_OK;
        sf_free(a->ctx, a->to.folder);
        a->to.folder = NULL;
    }
    return status;
}

static sf_status open_archive(archive *a) {
    struct stat st;
    int error = 0;
    if (stat(a->path, &st)) return sf_fail(a->ctx, SF_ERR_IO, "%s: %s", a->path, strerror(errno));
    a->size = (uint64_t)st.st_size;
    a->zip = zip_open(a->path, ZIP_RDONLY | ZIP_CHECKCONS, &error);
    if (a->zip) return SF_OK;
    zip_error_t text;
    zip_error_init_with_code(&text, error);
    sf_status status = error == ZIP_ER_MEMORY ? SF_ERR_MEMORY : SF_ERR_FORMAT;
    sf_fail(a->ctx, status, "%s: zip: %s", a->path, zip_error_strerror(&text));
    zip_error_fini(&text);
    return status;
}

sf_status sf_zip_unpack(sf_context *ctx, const char *path, sf_unpacked *unpacked) {
    archive a = {.ctx = ctx, .path = path, .to.lock = -1};
    const char *slash = strrchr(path, '/');
    sf_status status = open_archive(&a);
    if (!status) status = make_folder(&a);
    if (!status) a.to.project = sf_path_join(ctx, a.to.folder, slash ? slash + 1 : path);
    if (!status) status = a.to.project ? unpack_all(&a) : SF_ERR_MEMORY;
    if (a.zip) zip_discard(a.zip);
    if (status) sf_zip_remove(ctx, &a.to);
    *unpacked = a.to;
    return status;
}

#else

sf_status sf_zip_unpack(sf_context *ctx, const char *path, sf_unpacked *unpacked) {
    *unpacked = (sf_unpacked){.lock = -1};
    return sf_fail(ctx, SF_ERR_UNSUPPORTED,
                   "%s: this build reads no .zip: libzip was not there to build with; unpack it first", path);
}

void sf_zip_remove(sf_context *ctx, sf_unpacked *unpacked) { (void)ctx, (void)unpacked; }

#endif
