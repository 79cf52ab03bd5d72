#!/bin/sh
# sizes.sh NAME FILE... - a row for the table in README.md: bytes of each file without what only a debugger reads.
#
# NM names the tools.
set -eu

scratch=$(mktemp)
trap 'rm -f "$scratch"' EXIT
printf '| %s |' "$1"
shift
for file in "$@"; do
    "${NM%nm}strip" --strip-unneeded -o "$scratch" "$file"
    printf ' %s |' "$(stat -c %s "$scratch")"
done
echo
