#!/bin/sh
# headers.sh - every header compiles alone, the public ones as C++ too; splatfit.h includes all public ones.
# The vocabularies of the levels are parts of arch/vector/vec.h, which is compiled, with what uses it, at each of them.
set -eu

bad=0
for header in $(find include src arch tests -name '*.h' ! -path 'arch/x86/*' ! -path 'arch/arm/*' \
    ! -path arch/vector/vec.h ! -path arch/vector/sh.h ! -path arch/vector/interval.h | sort); do
    # shellcheck disable=SC2086
    ${CC:-gcc} ${CFLAGS:-} -Isrc -Itests -Werror -fsyntax-only -include "$header" -x c /dev/null || bad=1
done
for header in include/splatfit/*.h; do
    ${CXX:-g++} -std=c++11 -Wall -Wextra -Werror -fsyntax-only -include "$header" -x c++ /dev/null || bad=1
    name=$(basename "$header")
    if [ "$name" != splatfit.h ] && ! grep -q "^#include \"$name\"" include/splatfit/splatfit.h; then
        echo "include/splatfit/splatfit.h: does not include $name"
        bad=1
    fi
done
exit $bad
