#!/bin/sh
# format.sh - every C or C++ file is as .clang-format has it and opens with a line that says its name and purpose.
set -eu

command -v clang-format >/dev/null || {
    echo "clang-format is not installed"
    exit 77
}
bad=0
for file in $(find include src arch tests -name '*.[ch]' -o -name '*.cc' | sort | tests/lint/changed.sh); do
    clang-format "$file" | cmp -s - "$file" || {
        echo "$file: clang-format -i would change it"
        bad=1
    }
    head -n 1 "$file" | grep -q "^/\* $(basename "$file") - ." || {
        echo "$file: does not begin with /* $(basename "$file") - purpose. */"
        bad=1
    }
done
exit $bad
