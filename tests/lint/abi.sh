#!/bin/sh
# abi.sh - what SO gives to programs that link it is what tests/abi/abi.txt lists, under the version that context.h names;
# the changelog begins with the version of the library.
set -eu

command -v python3 >/dev/null || {
    echo "python3 is not installed"
    exit 77
}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
bad=0
number=$(sed -n 's/^#define SF_ABI *//p' include/splatfit/context.h)
grep -q "^SPLATFIT_$number {" src/exports.map || {
    echo "src/exports.map: its version is not SPLATFIT_$number, as SF_ABI in include/splatfit/context.h has it"
    bad=1
}
version=$(sed -n 's/^#define SF_VERSION *"\(.*\)"/\1/p' include/splatfit/context.h)
[ "$(grep -m 1 '^## ' include/splatfit/CHANGELOG.md)" = "## $version" ] || {
    echo "include/splatfit/CHANGELOG.md: does not begin with \"## $version\", as SF_VERSION in context.h has it"
    bad=1
}
objdump -p "$SO" | grep -q "SONAME *libsplatfit.so.$number\$" || {
    echo "$SO: its SONAME is not libsplatfit.so.$number"
    bad=1
}
tests/abi/list.py "$SO" >"$scratch/now"
LC_ALL=C diff -u0 --label tests/abi/abi.txt --label "$SO" tests/abi/abi.txt "$scratch/now" >"$scratch/changes" || {
    cat "$scratch/changes"
    if grep -q '^-[^-]' "$scratch/changes"; then
        echo "Lines that change or go break programs that are built: raise SF_ABI (once a release) and rename the version in"
        echo "src/exports.map, unless that was done since the last release. Then, and where lines only come: make abi"
    else
        echo "What came is no break: make abi"
    fi
    bad=1
}
exit $bad
