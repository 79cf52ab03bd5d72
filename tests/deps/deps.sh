#!/bin/sh
# deps.sh [--look] SET... - installs what is missing for the named sets: build, source, test, optional, ci, vm, browser, amd64,
# arm64, armhf.
#
# As root on Debian or Ubuntu it installs; anywhere else it names the packages and the command, and fails.
# With --look it never installs. What is there is found by use, not by package name, so that libraries may
# come from elsewhere; CC, CXX and CFLAGS are used for that. What is optional is installed where that can be done, and
# never missed.
set -eu

install=1
if [ "${1:-}" = --look ]; then
    install=0
    shift
fi

CC=${CC:-gcc}
CXX=${CXX:-g++}
missing=

# need PACKAGE TEST...: PACKAGE is missing unless TEST succeeds.
need() {
    package=$1
    shift
    "$@" >/dev/null 2>&1 || missing="$missing $package"
}

program() { command -v "$1"; }

# shellcheck disable=SC2086
compiles() { printf '%s\n' "$@" | $CC ${CFLAGS:-} -x c -fsyntax-only -; }

library() { # MODULE HEADER
    pkg-config --exists "$1" || compiles '#include <stdio.h>' "#include <$2>"
}

links_with_clang() { # FLAGS
    echo 'int main(void) { return 0; }' | clang "$@" -x c -o /dev/null -
}

need_build() {
    need gcc program "${CC%% *}"
    need libc6-dev compiles '#include <stdlib.h>'
    need pkg-config program pkg-config
    need libturbojpeg0-dev library libturbojpeg turbojpeg.h
    need libspng-dev library spng spng.h
    need libjansson-dev library jansson jansson.h
    need zlib1g-dev library zlib zlib.h
}

# To fetch sources from Debian.
need_source() {
    need debian-archive-keyring test -e /usr/share/keyrings/debian-archive-keyring.gpg
}

need_test() {
    need libcmocka-dev compiles '#include <setjmp.h>' '#include <stdarg.h>' '#include <stddef.h>' \
        '#include <stdint.h>' '#include <cmocka.h>'
}

# Without them the program lacks what they are for.
need_optional() {
    need g++ program "${CXX%% *}"
    need libcamera-dev pkg-config --exists libcamera
    need libapriltag-dev pkg-config --exists apriltag
    need libwebp-dev pkg-config --exists libwebp
    need libzip-dev pkg-config --exists libzip
    need libzstd-dev pkg-config --exists libzstd
    need libcivetweb-dev compiles '#include <civetweb.h>'
}

# The tools for a Debian sysroot and programs of another machine.
need_cross() { # TRIPLE CPU
    need "gcc-$(echo "$1" | tr _ -)" program "$1-gcc"
    need "g++-$(echo "$1" | tr _ -)" program "$1-g++"
    need pkg-config program pkg-config
    need qemu-user-static program "qemu-$2-static"
    need_source
}

need_ci() {
    need binutils program nm
    need g++ program g++
    need clang program clang
    need libclang-rt-dev links_with_clang -fsanitize=address,undefined
    need clang-format program clang-format
    need shellcheck program shellcheck
    need python3 program python3
    need mandoc program mandoc
    need lintian program lintian
    need qemu-user-static program qemu-x86_64-static
}

# An emulated board, its kernel and what it boots from.
need_vm() {
    need qemu-system-arm program qemu-system-aarch64
    need cpio program cpio
    need kmod test -x /sbin/modprobe
    need xz-utils program xz
    need_source
}

# To see the page of src/preview as its users do.
need_browser() {
    need chromium program chromium
    need fonts-dejavu-core test -d /usr/share/fonts/truetype/dejavu
}

for name in "$@"; do
    case $name in
    build) need_build ;;
    source) need_source ;;
    test) need_test ;;
    amd64) need_cross x86_64-linux-gnu x86_64 ;;
    arm64) need_cross aarch64-linux-gnu aarch64 ;;
    armhf) need_cross arm-linux-gnueabihf arm ;;
    optional) need_optional ;;
    ci) need_ci ;;
    vm) need_vm ;;
    browser) need_browser ;;
    *) echo "deps.sh: \"$name\" is none of build, source, test, optional, ci, vm, browser, amd64, arm64, armhf" >&2 && exit 2 ;;
    esac
done

missing=$(echo "$missing" | tr -s ' ' '\n' | sort -u | xargs)
[ -n "$missing" ] || exit 0

optional=0
[ "$*" = optional ] && optional=1
if [ $optional = 1 ] && { [ $install = 0 ] || ! program apt-get >/dev/null || [ "$(id -u)" != 0 ]; }; then exit 0; fi

command="apt-get install --no-install-recommends $missing"
if [ $install = 0 ] || ! program apt-get >/dev/null; then
    echo "missing: $missing (Debian's names); \"make deps\" installs them on Debian and Ubuntu" >&2
    exit 1
fi
if [ "$(id -u)" != 0 ]; then
    printf 'missing: %s\ninstall them with: sudo %s\n' "$missing" "$command" >&2
    exit 1
fi

echo "installing what is missing: $missing"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
# shellcheck disable=SC2086
install_now() { apt-get install -qq -y --no-install-recommends $missing >"$log" 2>&1; }
trap 'rm -f "$log"' EXIT
# A fresh system has no lists, and old lists may name packages that are gone.
if ! install_now && ! { apt-get update -qq >"$log" 2>&1 && install_now; }; then
    if [ $optional = 1 ]; then
        echo "deps.sh: cannot be installed, done without: $missing"
        exit 0
    fi
    cat "$log" >&2
    echo "deps.sh: $command: failed" >&2
    exit 1
fi
