#!/bin/sh
# static.sh - the static program has nothing of a dynamic one; it fits, and reads and writes pictures.
#
# RUN and PROGRAM as in levels.sh
set -eu

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# RUN is a command and its arguments.
# shellcheck disable=SC2086
splatfit() { ${RUN:-} "$PROGRAM" "$@"; }

# readelf reads every machine's files.
headers=$(readelf -Wld "$PROGRAM")
if echo "$headers" | grep -E 'INTERP|NEEDED|Dynamic section'; then
    echo "static.sh: $PROGRAM wants shared libraries"
    exit 1
fi
splatfit info --cpu
splatfit fit 'sim:studio?width=48&height=32&frames=8' --steps 5 --quiet -o "$scratch/model.ply" \
    --compare "$scratch/picture.png"
splatfit info "$scratch/model.ply"
cat >"$scratch/transforms.json" <<'END'
{"fl_x": 40, "frames": [{"file_path": "picture.png",
                         "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}
END
splatfit fit "$scratch" --steps 1 --hold-out 0 --init-random 50 --quiet -o "$scratch/model.ply"
