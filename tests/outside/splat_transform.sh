#!/bin/bash
# splat_transform.sh - a reader and writer of others, PlayCanvas's splat-transform, on our files and we on its.
#
# npm installs it, and a node new enough for it, into build/outside. Where that cannot be done all is skipped.
# RUN and PROGRAM as common.sh says.
set -uo pipefail

name=splat-transform
version=3.7.0
dir=build/outside
# shellcheck source=tests/outside/common.sh
. tests/outside/common.sh

command -v python3 >/dev/null || skip_all 'python3 is not installed'
install "$dir" "@playcanvas/splat-transform@$version"
tool=$dir/node_modules/.bin/splat-transform
"$interpreter" "$tool" --version >"$dir/version.log" 2>&1 ||
    skip_all "it does not run: $(tail -n 1 "$dir/version.log")"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Called through check.
# shellcheck disable=SC2317
theirs() { "$interpreter" "$tool" -q -w "$@"; }
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

# Moved alike: means, rotations, scales and all bands of the SH. It moves in the axes of its engine, where x and y of a .ply are
# negated.
check 'we turn, scale and move' ours convert "$work/model.ply" "$work/moved.ply" --rotate=-30,40,70 --scale 1.5 \
    --move=-1,2,3 -q
check 'it does' theirs "$work/model.ply" -r 30,-40,70 -s 1.5 -t 1,-2,3 "$work/moved-theirs.ply"
check 'as we do' alike rounded "$work/moved.ply" "$work/moved-theirs.ply"

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

# It writes glTF and reads none.
check 'writes .glb' theirs "$work/model.ply" "$work/theirs.glb"
check 'we read it' ours convert "$work/theirs.glb" "$work/theirs-glb.ply" -q
check 'and it is the same' alike rounded "$work/model.ply" "$work/theirs-glb.ply"
check 'we write .glb' ours convert "$work/theirs-glb.ply" "$work/ours.glb" -q
check 'we read it' ours convert "$work/ours.glb" "$work/ours-glb.ply" -q
check 'and it is the same' alike rounded "$work/model.ply" "$work/ours-glb.ply"

# It reads and writes compressed .ply; we read.
check 'writes .compressed.ply' theirs "$work/model.ply" "$work/theirs.compressed.ply"
check 'we read it' ours convert "$work/theirs.compressed.ply" "$work/theirs-packed.ply" -q
check 'it reads it' theirs "$work/theirs.compressed.ply" "$work/theirs-packed-theirs.ply"
check 'as we do' alike rounded "$work/theirs-packed.ply" "$work/theirs-packed-theirs.ply"

# SOG, both ways.
if ours info --build | grep -q 'libwebp.*not built in'; then
    skipped=$((skipped + 1))
    echo 'SKIPPED SOG: this build is without libwebp'
    finish
fi
check 'writes .sog' theirs -g cpu "$work/model.ply" "$work/theirs.sog"
check 'we read it' ours convert "$work/theirs.sog" "$work/theirs-sog.ply" -q
check 'it reads it' theirs "$work/theirs.sog" "$work/theirs-sog-theirs.ply"
check 'as we do' alike rounded "$work/theirs-sog.ply" "$work/theirs-sog-theirs.ply"
check 'we write .sog' ours convert "$work/model.ply" "$work/ours.sog" -q
check 'we read it' ours convert "$work/ours.sog" "$work/ours-sog.ply" -q
check 'reads our .sog' theirs "$work/ours.sog" "$work/ours-sog-theirs.ply"
check 'as we do' alike rounded "$work/ours-sog.ply" "$work/ours-sog-theirs.ply"
finish
