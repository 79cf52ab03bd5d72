#!/bin/sh
# links.sh - what the READMEs and other .md files link to in the tree is there.
set -eu

find . -name '*.md' ! -path './build/*' | sort | while read -r file; do
    grep -oE '\]\([^)# ]+' "$file" | sed 's/^](//' | grep -vE '^[a-z]+:' | while read -r link; do
        [ -e "$(dirname "$file")/$link" ] || echo "$file: there is no $link"
    done
done | awk '{ print } END { exit NR > 0 }'
