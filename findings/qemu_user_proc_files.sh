#!/bin/bash
# qemu_user_proc_files.sh - under qemu-user, each open of /proc/self/stat is another file, and a lock on it excludes nobody.
#
# A program that may run once in a process, such as a camera's driver, can take flock on a file of /proc/self, which needs no
# folder to write in and ends with the process. On a kernel all opens of it are one file. qemu-user writes what it shows of some
# of these files into a new temporary one at each open, so that ARM tests under it see a lock that is always granted.
set -euo pipefail

version=1:7.2+dfsg-7+deb12u18+b3
expected=$'kernel: one file, second lock refused\nqemu-user: two files, second lock granted'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

cat >lock.c <<'END_OF_C'
#include <fcntl.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/stat.h>

int main(void) {
    struct stat first, second;
    int a = open("/proc/self/stat", O_RDONLY), b = open("/proc/self/stat", O_RDONLY);
    if (a < 0 || b < 0 || fstat(a, &first) || fstat(b, &second) || flock(a, LOCK_EX | LOCK_NB)) return 1;
    printf("%s, ", first.st_dev == second.st_dev && first.st_ino == second.st_ino ? "one file" : "two files");
    printf("second lock %s\n", flock(b, LOCK_EX | LOCK_NB) ? "refused" : "granted");
    return 0;
}
END_OF_C
gcc -static -o lock lock.c
apt-get download -q "qemu-user-static=$version" >/dev/null 2>&1
dpkg -x qemu-user-static_*.deb qemu
seen=$(echo "kernel: $(./lock)" && echo "qemu-user: $("qemu/usr/bin/qemu-$(uname -m)-static" ./lock)")
echo "qemu-user-static $version"
echo "$seen"
[ "$seen" = "$expected" ] || { printf 'expected:\n%s\n' "$expected"; exit 1; }
