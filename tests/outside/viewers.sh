#!/bin/bash
# viewers.sh - viewers of others, in a headless Chromium, draw our files as we do.
#
# npm installs them into build/outside/viewers. Where that cannot be done, or without a Chromium, all is skipped. KEEP names a
# folder for the pictures. RUN and PROGRAM as common.sh says.
set -uo pipefail

name=viewers
dir=build/outside/viewers
# shellcheck source=tests/outside/common.sh
. tests/outside/common.sh

chromium=${SPLATFIT_CHROMIUM:-$(command -v chromium || command -v chromium-browser)}
[ -x "$chromium" ] || skip_all 'there is no Chromium'
command -v python3 >/dev/null || skip_all 'python3 is not installed'
install "$dir" @sparkjsdev/spark@2.2.0 three@0.180.0 @mkkellogg/gaussian-splats-3d@0.4.7 puppeteer-core@24.43.1
export SPLATFIT_CHROMIUM=$chromium

work=${KEEP:-$(mktemp -d)}
[ -n "${KEEP:-}" ] || trap 'rm -rf "$work"' EXIT
mkdir -p "$work"
# Called through check.
# shellcheck disable=SC2317
draw() { "$interpreter" tests/outside/viewer.mjs "$dir/node_modules" "$work/of-studio.ply/cameras.json" 8 "$@"; }
# shellcheck disable=SC2317
pictures() { python3 tests/outside/pictures.py "$@"; }

# Two scenes, seen by the same camera: one that was fitted, with all bands of the SH, and blobs apart from each other.
scene='sim:studio?width=320&height=240&frames=9'
ours fit "$scene" --steps 300 --max-gaussians 6000 --seed 1 --cameras none -q -o "$work/studio.ply" || { failed=1; finish; }
ours render "$work/studio.ply" "$scene" --split test --out "$work/of-studio.ply" -q || { failed=1; finish; }
python3 tests/outside/blobs.py "$work/of-studio.ply/cameras.json" 8 "$work/made.ply" || { failed=1; finish; }
check 'we write the blobs' ours convert "$work/made.ply" "$work/blobs.ply" -q
for kind in studio blobs; do
    check "we write bands 0 to 2 of the $kind" ours convert "$work/$kind.ply" "$work/$kind-2.ply" --sh-degree 2 -q
done
for kind in studio.spz studio.splat studio-2.ply blobs.ply blobs-2.ply; do
    [ -e "$work/$kind" ] || check "we write $kind" ours convert "$work/studio.ply" "$work/$kind" -q
    check "we draw $kind" ours render "$work/$kind" "$scene" --split test --out "$work/of-$kind" -q
done

# Spark reads all bands and all three formats; the other bands 0 to 2, and no .spz of version 3.
jobs=(spark studio.ply spark studio.spz spark studio.splat spark blobs.ply
    gs3d studio-2.ply gs3d studio.splat gs3d blobs-2.ply)
declare -a all
for ((i = 0; i < ${#jobs[@]}; i += 2)); do
    all+=("${jobs[i]}" "$work/${jobs[i + 1]}" "$work/${jobs[i]}-${jobs[i + 1]}.png")
done
SAY=1
check 'they draw' draw "${all[@]}"
for ((i = 0; i < ${#jobs[@]}; i += 2)); do
    theirs=$work/${jobs[i]}-${jobs[i + 1]}.png
    mine=$work/of-${jobs[i + 1]}/frame_0008.png
    check "${jobs[i]}, ${jobs[i + 1]}, PSNR to ours" pictures psnr "$mine" "$theirs" 30
    case ${jobs[i + 1]} in
        blobs*) check "${jobs[i]}, ${jobs[i + 1]}, centres" pictures centres "$mine" "$theirs" 1 ;;
    esac
done
finish
