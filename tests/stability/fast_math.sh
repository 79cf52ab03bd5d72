#!/bin/sh
# fast_math.sh FOLDER - tests a build with -ffast-math, in a separate folder: prints "refused 1" if it does
# not compile, and "noticed N of M" programs of the check that fail where it is made to.
#
# MAKE, CC   as for the Makefile
set -u

folder=$1
unset MAKEFLAGS MFLAGS
programs="$folder/tests/check/test_blend $folder/tests/check/test_project"

build() { # FLAGS TARGET...
    flags=$1
    shift
    "${MAKE:-make}" --no-print-directory -j2 TOOLCHAIN=native SAN= WERROR= ${CC:+CC="$CC"} "CFLAGS=-g0 $flags" "O=$folder" "$@" \
        >"$folder.log" 2>&1
}

mkdir -p "$folder"
if build -ffast-math "$folder/arch/scalar/blend.o"; then
    echo "refused 0"
else
    echo "refused $(grep -c 'rounded by itself' "$folder.log" | sed 's/^[1-9].*/1/')"
fi

# Names of programs are words.
# shellcheck disable=SC2086
build '-ffast-math -DSF_FAST_MATH_ANYWAY' $programs || {
    echo "fast_math.sh: the build failed; see $folder.log" >&2
    exit 1
}
noticed=0 count=0
for program in $programs; do
    count=$((count + 1))
    SPLATFIT_QUICK=1 SPLATFIT_SEED='' timeout -k 5 300 "$program" >"$program.out" 2>&1 || noticed=$((noticed + 1))
done
echo "noticed $noticed of $count"
