#!/bin/sh
# words.sh - what must not be written: flags that loosen arithmetic, and in the library calls that end the
# program or print.
set -eu

bad=0
if find Makefile arch src tests toolchains \( -name Makefile -o -name '*.mk' \) -print0 |
    xargs -0 grep -nE -e '-ffast-math|-Ofast|-funsafe-math'; then
    bad=1
fi
calls='(^|[^A-Za-z0-9_])(_?exit|abort|assert|perror|v?printf|puts|putchar) *\('
streams='std(out|err)([^A-Za-z0-9_]|$)'
if find src arch -path src/app -prune -o \( -name '*.[ch]' -o -name '*.cc' \) -print0 | xargs -0 grep -nE "$calls|$streams"; then
    bad=1
fi
exit $bad
