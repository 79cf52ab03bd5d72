#!/bin/sh
# config.sh FILE - writes what make reads about this machine's libraries to FILE: each library's flags, and which of the
# optional ones are there. FILE changes only where that has changed.
#
# First it installs what is missing, or where LOOK is not empty only names it. From the environment: DEPS and DEPS_OPTIONAL, sets of
# deps.sh; PREPARE, a command that brings libraries from elsewhere; CC, CXX, CFLAGS, PKG_CONFIG; LINK, the flags of a program;
# OPTIONAL, the modules of pkg-config that may be left out; STATIC.
set -eu

file=$1
here=$(dirname "$0")
mkdir -p "$(dirname "$file")"

# shellcheck disable=SC2086
if [ -n "${LOOK:-}" ]; then
    "$here/deps.sh" --look $DEPS
else
    "$here/deps.sh" $DEPS $DEPS_OPTIONAL >&2
fi
eval "$PREPARE" >&2

ask() { eval "$PKG_CONFIG $*" 2>/dev/null; }
closure=
[ "$STATIC" != 1 ] || closure=--static

# Of the program alone, and nothing but a header and a library tells of it.
has_civetweb() {
    # shellcheck disable=SC2086
    echo 'int main(void) { return !mg_version(); }' | $CC $LINK -include civetweb.h -x c -o /dev/null - -lcivetweb 2>/dev/null
}

# A g++ without its headers is there where only the compiler's driver was installed.
compiles_cxx() { echo '#include <memory>' | $CXX -x c++ -fsyntax-only - 2>/dev/null; }

# What each optional module is for, and Debian's package of it.
describe() {
    case $1 in
    apriltag) echo 'libapriltag-dev: boards' ;;
    libcamera) echo 'libcamera-dev and g++: libcamera: sources' ;;
    libzip) echo 'libzip-dev: projects in a .zip' ;;
    libzstd) echo 'libzstd-dev: .spz of version 4' ;;
    libwebp) echo 'libwebp-dev: .sog' ;;
    libexif) echo 'libexif-dev: the focal length that photos tell' ;;
    civetweb) echo 'libcivetweb-dev: the page in the browser' ;;
    esac
}

found='' civetweb='' cflags='' libs='' parts='' missing=''
for module in $OPTIONAL; do
    # libcamera's interface is C++.
    if ask --exists "$module" && { [ "$module" != libcamera ] || compiles_cxx; }; then
        found="$found $module"
    else
        missing="$missing $module"
    fi
done
if [ "$STATIC" != 1 ]; then
    if has_civetweb; then civetweb=-lcivetweb; else missing="$missing civetweb"; fi
fi

# Each is asked alone: one that is not there takes nothing from the others.
for module in libturbojpeg spng jansson zlib $found; do
    if version=$(ask --modversion "$module"); then
        cflags="$cflags $(ask --cflags "$module")"
        libs="$libs $(ask $closure --libs "$module")"
        parts="$parts $module=$version"
    else
        case $module in
        libturbojpeg) libs="$libs -lturbojpeg" ;;
        zlib) libs="$libs -lz" ;;
        *) libs="$libs -l$module" ;;
        esac
        parts="$parts $module=unknown"
    fi
done
[ -z "$civetweb" ] || parts="$parts civetweb=unknown"
test_libs=$(ask --libs cmocka || echo -lcmocka)

plain() { echo "$*" | tr -s ' ' | sed 's/^ //; s/ $//'; }
{
    echo "FOUND := $(plain "$found")"
    echo "CIVETWEB := $civetweb"
    echo "LIBS_CFLAGS := $(plain "$cflags")"
    echo "LIBS_FOUND := $(plain "$libs")"
    echo "TEST_LIBS := $(plain "$test_libs")"
    echo "PARTS := $(plain "$parts")"
} >"$file.$$"
if cmp -s "$file.$$" "$file"; then
    rm "$file.$$"
    exit 0
fi
# Several makes may write it at a time, and each reads a whole one.
mv "$file.$$" "$file"
for module in $missing; do echo "built without $(describe "$module") (install it, then run make again)" >&2; done
