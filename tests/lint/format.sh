#!/bin/sh
# format.sh - every C or C++ file is as .clang-format has it and opens with a line that says its name and purpose.
set -eu

command -v clang-format >/dev/null || {
    echo "clang-format is not installed"
    exit 77
}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
find include src arch tests -name '*.[ch]' -o -name '*.cc' | sort | tests/lint/changed.sh >"$scratch/files"
bad=0
# One process for all files: clang-format takes longer to start than to look through a file.
xargs -r clang-format --dry-run --Werror <"$scratch/files" >"$scratch/said" 2>&1 || bad=1
sed -n 's/^\([^: ]*\):[0-9]*:[0-9]*: .*\[-Wclang-format-violations\]$/\1: clang-format -i would change it/p' "$scratch/said" | sort -u
# What it says where it could not look.
grep -E '^[^ ]*: error: |^[A-Z]' "$scratch/said" | grep -v 'Wclang-format-violations' || true
# shellcheck disable=SC2016 # of awk's, not the shell's
xargs -r awk '
    FNR == 1 {
        name = FILENAME
        sub(/.*\//, "", name)
        if (index($0, "/* " name " - ") == 1 && length($0) > length("/* " name " - ")) next
        printf "%s: does not begin with /* %s - purpose. */\n", FILENAME, name
        bad = 1
    }
    { nextfile }
    END { exit bad }' <"$scratch/files" || bad=1
exit $bad
