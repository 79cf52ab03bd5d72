#!/bin/sh
# makefiles.sh - Makefile fits on two pages, no makefile has a line above 140 characters, and each begins with its name and purpose.
set -eu

bad=0
[ "$(wc -l <Makefile)" -le 130 ] || {
    echo "Makefile: more than 130 lines: move rules to the .mk files that it includes"
    bad=1
}
for file in Makefile $(find arch src tests toolchains -name '*.mk' | sort); do
    awk -v file="$file" 'length > 140 { print file ":" FNR ": " length " characters"; bad = 1 } END { exit bad }' "$file" || bad=1
    head -n 1 "$file" | grep -q "^# $(basename "$file") - ." || {
        echo "$file: does not begin with # $(basename "$file") - purpose."
        bad=1
    }
done
exit $bad
