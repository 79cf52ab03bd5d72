#!/bin/sh
# comments.sh - a comment speaks of every function, type, field, value and macro of the public headers.
set -eu

command -v python3 >/dev/null || {
    echo "python3 is not installed"
    exit 77
}
tests/docs/declarations.py --check include/splatfit/*.h
# The page of them all can be made.
tests/docs/declarations.py --html include/splatfit/*.h | grep -q 'id="sf_fitter_create"'
