#!/bin/bash
# sfm.sh [PHOTOS...] - cameras from photos: the seconds of each stage, and beside them COLMAP's where it is installed.
#
# Both run on THREADS threads (2), in turn: splatfit once before each of COLMAP's stages, and the median run counts. COLMAP has its
# own defaults, but one camera (RADIAL) for all photos, and the GPU is not used. models.py says how far apart the cameras are.
# Without PHOTOS: the simulated studio, whose true cameras are known, and the fox where SPLATFIT_DATA is set.
#
# PROGRAM, RUN: as for charts.sh.
set -euo pipefail
export LC_ALL=C QT_QPA_PLATFORM=offscreen

program=$(realpath "${PROGRAM:-build/splatfit}")
threads=${THREADS:-2}
here=$(realpath "$(dirname "$0")")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
if [ -n "${RUN:-}" ]; then
    echo "sfm: not measured, these programs are another machine's"
    exit 0
fi

# The line of a run: "SECONDS all that the program said last".
ours() { # PHOTOS
    local began=$EPOCHREALTIME last
    "$program" cameras "$1" -o "$scratch/ours" --threads "$threads" --progress none >"$scratch/said"
    last=$(tail -n 1 "$scratch/said")
    awk -v from="$began" -v to="$EPOCHREALTIME" -v last="$last" 'BEGIN { printf "%.2f %s\n", to - from, last }' >>"$scratch/runs"
}

median_run() { sort -g "$scratch/runs" | awk '{ run[NR] = $0 } END { print run[int((NR + 1) / 2)] }'; }

stage() { # NAME COMMAND...: adds "NAME SECONDS" to the stages
    local name=$1 began=$EPOCHREALTIME
    shift
    if ! "$@" >>"$scratch/colmap.log" 2>&1; then
        echo "  COLMAP's $1 failed: its log ends with"
        tail -n 3 "$scratch/colmap.log"
        return 1
    fi
    awk -v from="$began" -v to="$EPOCHREALTIME" -v name="$name" 'BEGIN { printf "%s %.2f\n", name, to - from }' >>"$scratch/stages"
}

theirs() { # PHOTOS
    local photos=$1 database=$scratch/colmap.db
    mkdir -p "$scratch/theirs"
    ours "$photos"
    stage features colmap feature_extractor --database_path "$database" --image_path "$photos" \
        --ImageReader.single_camera 1 --ImageReader.camera_model RADIAL --SiftExtraction.use_gpu 0 \
        --SiftExtraction.num_threads "$threads" || return
    ours "$photos"
    stage matches,pairs colmap exhaustive_matcher --database_path "$database" --SiftMatching.use_gpu 0 \
        --SiftMatching.num_threads "$threads" || return
    ours "$photos"
    stage mapping colmap mapper --database_path "$database" --image_path "$photos" --output_path "$scratch/theirs" \
        --Mapper.num_threads "$threads"
}

# Of several models of COLMAP's, the one of most photos.
largest() {
    local model best='' most=0 count
    for model in "$scratch"/theirs/*/; do
        [ -f "$model/images.bin" ] || continue
        count=$(od -An -tu8 -N8 "$model/images.bin" | tr -d ' ')
        if [ "$count" -gt "$most" ]; then best=$model most=$count; fi
    done
    echo "$best"
}

beside() { # TRUTH, or nothing
    local model seconds
    model=$(largest)
    seconds=$(median_run)
    seconds=${seconds%% *}
    awk -v ours="$seconds" '
        { all += $2; text = text (NR > 1 ? ", " : "") $1 " " sprintf("%.1f", $2) }
        END { printf "  COLMAP: %.1f s (%s), %.1f times as long\n", all, text, all / ours }' "$scratch/stages"
    [ -n "$model" ] || {
        echo "  COLMAP made no model"
        return
    }
    echo "  COLMAP placed $(od -An -tu8 -N8 "$model/images.bin" | tr -d ' ')"
    echo "  splatfit and COLMAP: $("$here/models.py" "$scratch/ours/sparse/0" "$model")"
    [ -z "${1:-}" ] || echo "  COLMAP and the truth: $("$here/models.py" "$model" "$1")"
}

measure() { # PHOTOS NAME TRUTH
    rm -rf "${scratch:?}"/{ours,theirs,runs,stages,colmap.db}
    echo "$2: $(find -L "$1" -maxdepth 1 -type f | wc -l) photos, $threads threads"
    if command -v colmap >/dev/null; then
        theirs "$1" || rm -f "$scratch/stages"
    else
        echo "  COLMAP is not installed: not measured"
        ours "$1"
    fi
    median_run | sed 's/^\([^ ]*\) /  splatfit: \1 s in all; /'
    [ -z "${3:-}" ] || echo "  splatfit and the truth: $("$here/models.py" "$scratch/ours/sparse/0" "$3")"
    [ ! -f "$scratch/stages" ] || beside "${3:-}"
}

if [ $# -gt 0 ]; then
    for photos in "$@"; do measure "$photos" "$(basename "$photos")"; done
    exit
fi
"$program" capture sim:studio -o "$scratch/studio" --format png -q
measure "$scratch/studio/images" studio "$scratch/studio/transforms.json"
if [ -d "${SPLATFIT_DATA:-none}/fox/images_2" ]; then
    measure "$SPLATFIT_DATA/fox/images_2" fox
else
    echo "SPLATFIT_DATA is not set: the fox was not measured"
fi
