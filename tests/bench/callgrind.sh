#!/bin/sh
# callgrind.sh FILE LEVEL... - counts each kernel's instructions under valgrind, one run a level.
#
# Writes lines "level kernel instructions-a-unit" to FILE, for splatfit bench --instructions; none where valgrind
# is missing, and none for a level that valgrind does not know (it knows up to AVX2).
#
# PROGRAM   the program, build/splatfit if unset
# RUN       set where the program is another machine's: nothing is counted then
set -eu

file=$1
shift
mkdir -p "$(dirname "$file")"
: >"$file"
if [ -n "${RUN:-}" ] || ! command -v valgrind >/dev/null; then
    echo "instructions: not counted, valgrind is not there or does not run this machine's programs"
    exit 0
fi
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for level in scalar "$@"; do
    if ! valgrind --tool=callgrind --callgrind-out-file="$scratch/out" "${PROGRAM:-build/splatfit}" \
        bench --once --isa "$level" >"$scratch/units" 2>"$scratch/log"; then
        echo "instructions: not counted at $level, which valgrind does not run"
        continue
    fi
    callgrind_annotate --inclusive=yes --threshold=100 "$scratch/out" >"$scratch/costs"
    # "12,345 (67.8%)  file.c:function [object]"; a function's largest line is the one of all its calls
    awk -v level="$level" '
        NR == FNR { units[$1] = $2; next }
        {
            for (name in units)
                if (index($0, ":" name " ") || index($0, ":" name "'\''")) {
                    count = $1
                    gsub(",", "", count)
                    if (count + 0 > most[name]) most[name] = count + 0
                }
        }
        END {
            for (name in units) {
                kernel = name
                sub(/^sf_/, "", kernel)
                sub("_" level "$", "", kernel)
                if (most[name]) printf "%s %s %.3f\n", level, kernel, most[name] / units[name]
            }
        }' "$scratch/units" "$scratch/costs" >>"$file"
done
echo "instructions: $file"
