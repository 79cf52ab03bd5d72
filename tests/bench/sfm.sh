#!/bin/bash
# sfm.sh [PHOTOS...] - cameras from photos: the seconds of each stage, and beside them COLMAP's where it is installed, in one run on
# as many threads. PROGRAM: splatfit; THREADS: 2. Without PHOTOS: the simulated studio, and the fox where SPLATFIT_DATA is set.
set -euo pipefail
export LC_ALL=C

: "${PROGRAM:?the program}"
program=$(realpath "$PROGRAM")
threads=${THREADS:-2}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# The stages' seconds of splatfit's last line.
ours() { # PHOTOS
    "$program" cameras "$1" -o "$folder/ours" --threads "$threads" --progress none | tail -n 1
}

stage() { # NAME COMMAND...: adds the seconds to $all
    local name=$1 began=$EPOCHREALTIME
    shift
    "$@" >>"$folder/colmap.log" 2>&1 || {
        echo "  COLMAP's $1 failed: its log ends with"
        tail -n 3 "$folder/colmap.log"
        return 1
    }
    awk -v from="$began" -v to="$EPOCHREALTIME" -v name="$name" 'BEGIN { printf "%s %.1f, ", name, to - from }'
    all=$(awk -v from="$began" -v to="$EPOCHREALTIME" -v all="$all" 'BEGIN { print all + to - from }')
}

# COLMAP with its own defaults, but for one camera for all and no GPU.
theirs() { # PHOTOS
    local photos=$1 database=$folder/colmap.db
    all=0
    mkdir -p "$folder/theirs"
    printf '  COLMAP: '
    stage features colmap feature_extractor --database_path "$database" --image_path "$photos" \
        --ImageReader.single_camera 1 --ImageReader.camera_model RADIAL --SiftExtraction.use_gpu 0 \
        --SiftExtraction.num_threads "$threads"
    stage matches colmap exhaustive_matcher --database_path "$database" --SiftMatching.use_gpu 0 \
        --SiftMatching.num_threads "$threads"
    stage mapping colmap mapper --database_path "$database" --image_path "$photos" --output_path "$folder/theirs" \
        --Mapper.num_threads "$threads"
    echo "together $all s"
}

# How far apart both are, after alignment by a similarity: medians; centres in COLMAP's units and in parts of their spread.
compare() {
    colmap model_comparer --input_path1 "$folder/theirs/0" --input_path2 "$folder/ours/sparse/0" --output_path "$folder" \
        >>"$folder/colmap.log" 2>&1
    colmap model_converter --input_path "$folder/theirs/0" --output_path "$folder" --output_type TXT >>"$folder/colmap.log" 2>&1
    local spread
    spread=$(spread "$folder/images.txt")
    for column in 1 3; do
        grep -v '^#' "$folder/errors.csv" | cut -d, -f$column | sort -g | awk -v column=$column -v spread="$spread" '
            { v[NR] = $1 }
            END {
                m = v[int((NR + 1) / 2)]
                if (column == 1) printf "  apart from COLMAP, medians of %d photos: rotation %.3f degrees, ", NR, m
                else printf "centre %.2f %% of the cameras'"'"' spread\n", 100 * m / spread
            }'
    done
}

# The median distance of the cameras from their mean, in COLMAP's text: the first of each two lines has the pose.
spread() { # IMAGES.TXT
    grep -v '^#' "$1" | awk 'NR % 2 {
            w = $2; x = $3; y = $4; z = $5
            # -R^T t
            cx[++n] = -((1 - 2 * (y * y + z * z)) * $6 + 2 * (x * y + w * z) * $7 + 2 * (x * z - w * y) * $8)
            cy[n] = -(2 * (x * y - w * z) * $6 + (1 - 2 * (x * x + z * z)) * $7 + 2 * (y * z + w * x) * $8)
            cz[n] = -(2 * (x * z + w * y) * $6 + 2 * (y * z - w * x) * $7 + (1 - 2 * (x * x + y * y)) * $8)
            mx += cx[n]; my += cy[n]; mz += cz[n]
        }
        END { for (i = 1; i <= n; i++) print sqrt((cx[i] - mx / n) ^ 2 + (cy[i] - my / n) ^ 2 + (cz[i] - mz / n) ^ 2) }' |
        sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'
}

measure() { # PHOTOS NAME
    echo "$2: $(find "$1/" -maxdepth 1 -type f | wc -l) photos"
    printf '  splatfit: '
    ours "$1"
    if command -v colmap >/dev/null; then
        QT_QPA_PLATFORM=offscreen theirs "$1" && compare
    else
        echo "  COLMAP is not installed: not measured"
    fi
    rm -rf "${folder:?}"/*
}

if [ $# -gt 0 ]; then
    for photos in "$@"; do measure "$photos" "$(basename "$photos")"; done
    exit
fi
"$program" capture sim:studio -o "$folder/studio" --format png -q
mv "$folder/studio/images" "$folder.studio"
trap 'rm -rf "$folder" "$folder.studio"' EXIT
measure "$folder.studio" studio
if [ -n "${SPLATFIT_DATA:-}" ] && [ -d "$SPLATFIT_DATA/fox/images_2" ]; then
    measure "$SPLATFIT_DATA/fox/images_2" fox
else
    echo "SPLATFIT_DATA is not set: the fox was not measured"
fi
