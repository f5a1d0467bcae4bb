/* Calls to the system that fail when they are told to: loaded before the C library (LD_PRELOAD).

   Counted are calls about files below one folder, forks, and allocations from a size on, from when it is armed. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <spawn.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NONE, OPEN, WRITE, RENAME, FSYNC, MKDIR, UNLINK, FORK, MALLOC };
static volatile int kind = NONE, left = 0, fired = 0, error = 0;
static volatile size_t least = 0;
static char folder[PATH_MAX];

void failing_calls_arm(int which, int nth, int code, size_t bytes, const char *below) {
    fired = 0;
    error = code;
    least = bytes;
    strncpy(folder, below, sizeof folder - 1);
    left = nth;
    kind = which;
}

int failing_calls_disarm(void) {
    kind = NONE;
    return fired;
}

static int due(int which) {
    if (kind != which || __atomic_sub_fetch(&left, 1, __ATOMIC_SEQ_CST) != 0) return 0;
    fired = 1;
    errno = error;
    return 1;
}

static int below(const char *path) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 && (path[length] == '/' || path[length] == 0);
}

static int of_descriptor(int descriptor) {
    char name[64], path[PATH_MAX];
    snprintf(name, sizeof name, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(name, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return below(path);
}

static int of_path(int directory, const char *path) {
    if (path[0] == '/') return below(path);
    if (directory != AT_FDCWD) return of_descriptor(directory);
    char here[PATH_MAX];
    return getcwd(here, sizeof here) != NULL && below(here);
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (real == NULL) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

#define MODE_OF(flags, mode) \
    va_list rest; va_start(rest, flags); \
    mode_t mode = (flags & (O_CREAT | O_TMPFILE)) ? va_arg(rest, mode_t) : 0; va_end(rest)

#define OPEN_LIKE(function) \
    int function(const char *path, int flags, ...) { \
        MODE_OF(flags, mode); REAL(int, #function, const char *, int, ...); \
        return kind == OPEN && of_path(AT_FDCWD, path) && due(OPEN) ? -1 : real(path, flags, mode); }
#define OPENAT_LIKE(function) \
    int function(int directory, const char *path, int flags, ...) { \
        MODE_OF(flags, mode); REAL(int, #function, int, const char *, int, ...); \
        return kind == OPEN && of_path(directory, path) && due(OPEN) ? -1 : real(directory, path, flags, mode); }
OPEN_LIKE(open)
OPEN_LIKE(open64)
OPENAT_LIKE(openat)
OPENAT_LIKE(openat64)

ssize_t write(int descriptor, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    return kind == WRITE && of_descriptor(descriptor) && due(WRITE) ? -1 : real(descriptor, data, size);
}

#define PWRITE_LIKE(function) \
    ssize_t function(int descriptor, const void *data, size_t size, off_t at) { \
        REAL(ssize_t, #function, int, const void *, size_t, off_t); \
        return kind == WRITE && of_descriptor(descriptor) && due(WRITE) ? -1 : real(descriptor, data, size, at); }
PWRITE_LIKE(pwrite)
PWRITE_LIKE(pwrite64)

int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    return kind == RENAME && of_path(AT_FDCWD, to) && due(RENAME) ? -1 : real(from, to);
}

int renameat(int a, const char *from, int b, const char *to) {
    REAL(int, "renameat", int, const char *, int, const char *);
    return kind == RENAME && of_path(b, to) && due(RENAME) ? -1 : real(a, from, b, to);
}

int fsync(int descriptor) {
    REAL(int, "fsync", int);
    return kind == FSYNC && of_descriptor(descriptor) && due(FSYNC) ? -1 : real(descriptor);
}

int mkdir(const char *path, mode_t mode) {
    REAL(int, "mkdir", const char *, mode_t);
    return kind == MKDIR && of_path(AT_FDCWD, path) && due(MKDIR) ? -1 : real(path, mode);
}

int mkdirat(int directory, const char *path, mode_t mode) {
    REAL(int, "mkdirat", int, const char *, mode_t);
    return kind == MKDIR && of_path(directory, path) && due(MKDIR) ? -1 : real(directory, path, mode);
}

int unlink(const char *path) {
    REAL(int, "unlink", const char *);
    return kind == UNLINK && of_path(AT_FDCWD, path) && due(UNLINK) ? -1 : real(path);
}

int unlinkat(int directory, const char *path, int flags) {
    REAL(int, "unlinkat", int, const char *, int);
    return kind == UNLINK && of_path(directory, path) && due(UNLINK) ? -1 : real(directory, path, flags);
}

pid_t fork(void) {
    REAL(pid_t, "fork", void);
    return due(FORK) ? -1 : real();
}

/* A wrapper of vfork would return into a frame that the child has overwritten: it becomes a fork. */
pid_t vfork(void) {
    return fork();
}

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);

void *malloc(size_t size) {
    return size >= least && due(MALLOC) ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size) {
    return count * size >= least && due(MALLOC) ? NULL : __libc_calloc(count, size);
}

void *realloc(void *old, size_t size) {
    return size >= least && due(MALLOC) ? NULL : __libc_realloc(old, size);
}
