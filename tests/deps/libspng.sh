#!/bin/sh
# libspng.sh DIR - puts Debian's source of libspng, spng.c and spng.h, into DIR: its package has no static library.
#
# Nothing is done where DIR is already there. MIRROR and SUITE as in apt.sh, which checks the source's signature.
set -eu

here=$(realpath "$(dirname "$0")")
dir=$1
if [ -e "$dir/spng.c" ]; then exit 0; fi

echo "fetching the source of libspng to $dir"
new=$dir.$$
trap 'rm -rf "$new"' EXIT
trap 'exit 1' INT TERM
mkdir -p "$new/source"
new=$(realpath "$new")
# shellcheck source=tests/deps/apt.sh
. "$here/apt.sh"
begin_apt "$new/apt" deb-src "$(dpkg --print-architecture)"
(cd "$new/source" && private_apt --download-only source libspng)
# Debian does not patch it.
tar -x -C "$new/source" --strip-components=1 -f "$new"/source/*.orig.tar.*
mkdir "$new/done"
cp "$new/source/spng/spng.c" "$new/source/spng/spng.h" "$new/source/LICENSE" "$new/done"
# Another make may have been faster.
mv -T "$new/done" "$dir" 2>/dev/null || [ -e "$dir/spng.c" ]
