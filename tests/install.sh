#!/bin/sh
# install.sh - installs into a scratch folder and builds a program against that through pkg-config, both ways.
set -eu

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${MAKE:-make}" --no-print-directory -s install DESTDIR="$scratch" PREFIX=/usr LIBDIR=/usr/lib

cat >"$scratch/program.c" <<'END'
#include <splatfit/splatfit.h>
#include <stdio.h>
int main(void) {
    sf_context *context = NULL;
    sf_status status = sf_context_create(&context, NULL);
    sf_context_destroy(&context);
    return puts(sf_version()) < 0 || status != SF_OK;
}
END

export PKG_CONFIG_PATH="$scratch/usr/lib/pkgconfig"
version=$(pkg-config --modversion splatfit)
include=$scratch$(pkg-config --variable=includedir splatfit)
lib=$scratch$(pkg-config --variable=libdir splatfit)

build() { ${CC:-gcc} -I"$include" "$scratch/program.c" -L"$lib" "$@" -o "$scratch/program"; }
says_version() {
    case $("$@") in
    *"$version"*) ;;
    *) echo "install.sh: $*: does not say version $version" && exit 1 ;;
    esac
}

# What pkg-config prints are words.
# shellcheck disable=SC2046
build $(pkg-config --libs splatfit)
LD_LIBRARY_PATH="$lib" says_version "$scratch/program"
rm "$lib"/libsplatfit.so*
# shellcheck disable=SC2046
build $(pkg-config --static --libs splatfit)
says_version "$scratch/program"
says_version "$scratch/usr/bin/splatfit" --version
