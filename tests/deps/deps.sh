#!/bin/sh
# deps.sh [--look] SET... - installs what is missing for the named sets: build, source, test, optional, static, ci, bench, vm, browser, amd64,
# arm64, armhf.
#
# As root on Debian or Ubuntu it installs; anywhere else it names the packages and the command, and fails.
# What is optional is installed, or named, with the rest; where it alone is missing and cannot be installed, that is no failure.
# With --look it never installs. What is there is found by use, not by package name, so that libraries may
# come from elsewhere; CC, CXX and CFLAGS are used for that.
set -eu

install=1
if [ "${1:-}" = --look ]; then
    install=0
    shift
fi

CC=${CC:-gcc}
CXX=${CXX:-g++}
missing=
wanted=

# need PACKAGE TEST...: PACKAGE is missing unless TEST succeeds.
need() {
    package=$1
    shift
    "$@" >/dev/null 2>&1 || missing="$missing $package"
}

# want PACKAGE TEST...: the same for what is optional.
want() {
    package=$1
    shift
    "$@" >/dev/null 2>&1 || wanted="$wanted $package"
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

# Without them the program lacks what they are for. The first is all that a static program takes of them.
need_static() {
    want libexif-dev pkg-config --exists libexif
}

need_optional() {
    need_static
    want g++ program "${CXX%% *}"
    want libcamera-dev pkg-config --exists libcamera
    want libapriltag-dev pkg-config --exists apriltag
    want libwebp-dev pkg-config --exists libwebp
    want libzip-dev pkg-config --exists libzip
    want libzstd-dev pkg-config --exists libzstd
    want libcivetweb-dev compiles '#include <civetweb.h>'
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
    # Both make it faster, no more.
    want ccache program ccache
    want mold program mold
    need libopenmpi-dev pkg-config --exists ompi-c
    need openmpi-bin program mpirun.openmpi
    need libmpich-dev pkg-config --exists mpich
    need mpich program mpirun.mpich
    need binutils program nm
    need g++ program g++
    need clang program clang
    need libclang-rt-dev links_with_clang -fsanitize=address,undefined
    need clang-format program clang-format
    need shellcheck program shellcheck
    need python3 program python3
    need mandoc program mandoc
    need ffmpeg program ffmpeg
    need lintian program lintian
    need debootstrap program debootstrap
    need debian-archive-keyring test -e /usr/share/keyrings/debian-archive-keyring.gpg
    need qemu-user-static program qemu-x86_64-static
}

# Estimates of ARM: LLVM 19 is the first with a model of neoverse-n1.
need_bench() {
    need llvm-19 program llvm-mca-19
    need clang-19 program clang-19
    need gcc-aarch64-linux-gnu program aarch64-linux-gnu-gcc
    need gcc-arm-linux-gnueabihf program arm-linux-gnueabihf-gcc
    need python3 program python3
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
    static) need_static ;;
    ci) need_ci ;;
    bench) need_bench ;;
    vm) need_vm ;;
    browser) need_browser ;;
    *) echo "deps.sh: \"$name\" is none of build, source, test, optional, static, ci, bench, vm, browser, amd64, arm64, armhf" >&2 && exit 2 ;;
    esac
done

sorted() { echo "$*" | tr -s ' ' '\n' | sort -u | xargs; }
missing=$(sorted "$missing")
all=$(sorted "$missing $wanted")
[ -n "$all" ] || exit 0

can_install() { [ $install = 1 ] && program apt-get >/dev/null && [ "$(id -u)" = 0 ]; }
can_install || [ -n "$missing" ] || exit 0

if [ $install = 0 ] || ! program apt-get >/dev/null; then
    echo "missing: $missing (Debian's names); \"make deps\" installs them on Debian and Ubuntu" >&2
    exit 1
fi
if ! can_install; then
    printf 'missing: %s\ninstall them with: sudo apt-get install --no-install-recommends %s\n' "$all" "$all" >&2
    exit 1
fi

echo "installing what is missing: $all"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# shellcheck disable=SC2086
install_now() { apt-get install -qq -y --no-install-recommends $1 >"$log" 2>&1; }
# A fresh system has no lists, and old lists may name packages that are gone.
if install_now "$all" || { apt-get update -qq >"$log" 2>&1 && install_now "$all"; }; then exit 0; fi
if [ -n "$missing" ] && ! install_now "$missing"; then
    cat "$log" >&2
    echo "deps.sh: apt-get install --no-install-recommends $missing: failed" >&2
    exit 1
fi
echo "deps.sh: cannot be installed, done without: $(sorted "$wanted")"
