#!/bin/bash
# splat_transform.sh - a reader and writer of others, PlayCanvas's splat-transform, on our files and we on its.
#
# npm installs it, and a node new enough for it, into build/outside. Where that cannot be done all is skipped.
#
# RUN      runs a program of another machine here
# PROGRAM  the program
set -uo pipefail

version=3.7.0
node=22
program=$(realpath "${PROGRAM:-build/splatfit}")
dir=build/outside
passed=0 failed=0 skipped=0

finish() {
    echo "$passed passed, $failed failed, $skipped skipped"
    [ $failed = 0 ]
    exit
}

check() { # NAME COMMAND...
    local name=$1 said
    shift
    if said=$("$@" 2>&1); then
        passed=$((passed + 1))
        printf 'passed  %s\n' "$name"
    else
        failed=$((failed + 1))
        printf 'FAILED  %s\n%s\n' "$name" "$said"
    fi
}

skip_all() { # WHY
    skipped=1
    printf 'SKIPPED splat-transform: %s\n' "$1"
    finish
}

command -v npm >/dev/null || skip_all 'npm is not installed'
command -v python3 >/dev/null || skip_all 'python3 is not installed'
mkdir -p "$dir"
tool=$dir/node_modules/.bin/splat-transform
if ! [ -e "$dir/$version-$node" ]; then
    (cd "$dir" && npm install --no-audit --no-fund --no-package-lock --prefix . \
        "@playcanvas/splat-transform@$version" "node@$node") >"$dir/npm.log" 2>&1 ||
        skip_all "npm cannot install it: $(tail -n 1 "$dir/npm.log")"
    touch "$dir/$version-$node"
fi
# The package "node" brings its program by a script that npm may be told not to run.
interpreter=$dir/node_modules/node/bin/node
[ -x "$interpreter" ] || interpreter=$(command -v node) || skip_all 'there is no node'
"$interpreter" "$tool" --version >"$dir/version.log" 2>&1 ||
    skip_all "it does not run: $(tail -n 1 "$dir/version.log")"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Called through check.
# shellcheck disable=SC2317
theirs() { "$interpreter" "$tool" -q -w "$@"; }
# RUN is a command and its arguments.
# shellcheck disable=SC2086,SC2317
ours() { ${RUN:-} "$program" "$@"; }
# shellcheck disable=SC2317
alike() { python3 tests/outside/alike.py "$@"; }

# A model of all bands, small and without what a file cannot hold.
ours fit sim:studio?width=64\&height=48\&frames=9 --steps 60 --max-gaussians 500 --seed 1 --cameras none -q \
    -o "$work/model.ply" || { failed=1; finish; }

# Ours, read by the other and given back as .ply: to the bit, and where quantised as we read it.
check 'reads our .ply' theirs "$work/model.ply" "$work/ply.ply"
check 'and it is the same' alike exact "$work/model.ply" "$work/ply.ply"
check 'we write .spz' ours convert "$work/model.ply" "$work/ours.spz" -q
check 'we read it' ours convert "$work/ours.spz" "$work/ours.ply" -q
check 'reads our .spz' theirs "$work/ours.spz" "$work/ours-theirs.ply"
check 'as we do' alike rounded "$work/ours.ply" "$work/ours-theirs.ply"
check 'in our frame, within the steps of the format' alike steps "$work/model.ply" "$work/ours-theirs.ply"
check 'we write .splat' ours convert "$work/model.ply" "$work/ours.splat" -q
check 'we read it' ours convert "$work/ours.splat" "$work/splat.ply" -q
check 'reads our .splat' theirs "$work/ours.splat" "$work/splat-theirs.ply"
check 'as we do, but for its own rounding of rotations' alike splat "$work/splat.ply" "$work/splat-theirs.ply"

# The other's, read by us.
for v in 3 4; do
    check "writes .spz of version $v" theirs --spz-version $v "$work/model.ply" "$work/theirs-$v.spz"
    if [ $v = 4 ] && ours info "$work/theirs-4.spz" 2>&1 | grep -q 'this build is without'; then
        skipped=$((skipped + 1))
        echo 'SKIPPED version 4: this build is without zstd'
        continue
    fi
    check 'we read it' ours convert "$work/theirs-$v.spz" "$work/theirs-$v.ply" -q
    check 'it reads it' theirs "$work/theirs-$v.spz" "$work/theirs-$v-theirs.ply"
    check 'as we do' alike rounded "$work/theirs-$v.ply" "$work/theirs-$v-theirs.ply"
    check 'in our frame, within the steps of the format' alike steps "$work/model.ply" "$work/theirs-$v.ply"
done
finish
