#!/bin/sh
# scripts.sh - shellcheck has nothing to say about the scripts.
set -eu

command -v shellcheck >/dev/null || {
    echo "shellcheck is not installed"
    exit 77
}
find .ci findings src tests toolchains -type f \( -name '*.sh' -o -name '*.bash' -o -path .ci/run \) | tests/lint/changed.sh |
    xargs -r shellcheck -x
