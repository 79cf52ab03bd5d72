#!/bin/bash
# qemu_user_posix_spawn.sh - under qemu-user, posix_spawnp starts a program that is not there.
#
# The C library's posix_spawn tells the caller, as an error number, that a program cannot be executed: its child, started like one
# of vfork, shares the caller's memory and writes the error there. qemu-user gives the child a memory of its own, so that the caller
# sees success, and a child that ends with status 127. Tests of an optional program that is missing thus fail under emulation.
set -euo pipefail

version=1:7.2+dfsg-7+deb12u18+b3
expected=$'kernel: refused, No such file or directory\nqemu-user: started, exit status 127'
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

cat >spawn.c <<'END_OF_C'
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

extern char **environ;

int main(void) {
    char *command[] = {"no-such-program", NULL};
    pid_t pid;
    int status = 0, error = posix_spawnp(&pid, command[0], NULL, NULL, command, environ);
    if (error) {
        printf("refused, %s\n", strerror(error));
        return 0;
    }
    if (waitpid(pid, &status, 0) != pid) return 1;
    printf("started, exit status %d\n", WEXITSTATUS(status));
    return 0;
}
END_OF_C
gcc -static -o spawn spawn.c
apt-get download -q "qemu-user-static=$version" >/dev/null 2>&1
dpkg -x qemu-user-static_*.deb qemu
seen=$(echo "kernel: $(./spawn)" && echo "qemu-user: $("qemu/usr/bin/qemu-$(uname -m)-static" ./spawn)")
echo "qemu-user-static $version"
echo "$seen"
[ "$seen" = "$expected" ] || { printf 'expected:\n%s\n' "$expected"; exit 1; }
