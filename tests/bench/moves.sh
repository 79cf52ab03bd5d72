#!/bin/bash
# moves.sh DIR [quick] - what each move of the schedule is worth: DIR/schedule-SCENE.json for `splatfit chart`, and
# DIR/moves.md, a table.
#
# The chart adds the moves one after another to a fit as the field's programs plan it for 30,000 steps: the seconds (of the
# steps alone) and the steps of the shortest fit that reaches the quality which the fit without any move reaches with 2,000.
# The table leaves out one move at a time.
#
# PROGRAM, RUN, SPLATFIT_DATA: as for charts.sh. MOVED: which of fox and studio.
set -euo pipefail

dir=$1
kind=${2:-full}
program=${PROGRAM:-build/splatfit}
here=$(dirname "$0")
mkdir -p "$dir"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# A move: its name, what the fit without it has, separated by |. With it, the default holds.
moves=(
    'colours faster|--lr-sh0 0.0025 --lr-sh-rest 0.000125'
    'small pictures first|--pyramid-levels 0'
    'full and half by turns|--pyramid-mix 1e-9'
    'shapes, opacities faster|--lr-scale 0.005 --lr-opacity 0.05 --lr-quat 0.001'
    'means faster|--lr-mean 1.6e-4 --lr-mean-final 0.01'
    'shorter first moment|--adam-beta1 0.9'
    'opaque at first|--init-opacity 0.1'
    'split for clones too|--split-scale 0.01'
    'growth in its first half|--densify-end 0.8 --densify-per-step 1000000'
    'settling|--cool-down 1'
    'rates by the length of the run|--lr-boost 1'
    'smaller at first|--init-scale 1'
    'squares first|--huber-delta 1e-9'
    'shorter second moment|--adam-beta2 0.999'
    'no needles|--max-aspect 0'
)

if [ "$kind" = quick ]; then
    scenes=${MOVED:-studio}
    ladder=(20 40) seeds=(1) lengths=(30) reference=40 most='--max-gaussians 1000'
    studio='sim:studio?width=80&height=60&frames=20'
    moves=("${moves[@]:0:3}")
else
    scenes=${MOVED:-fox studio}
    ladder=(200 280 400 560 800 1130 1600 2260) seeds=(1 2) lengths=(800) reference=2000 most='--max-gaussians 30000'
    studio=sim:studio
fi

# psnr, seconds and ssim of a fit, means over the seeds.
fit() { # PROJECT STEPS OPTION...
    local project=$1 steps=$2 seed
    shift 2
    for seed in "${seeds[@]}"; do
        # shellcheck disable=SC2086
        ${RUN:-} "$program" fit "$project" -o /dev/null --seed "$seed" --steps "$steps" --validate 0 --size cap --densify-per-step 13 $most --log "$scratch/log.json" \
            --progress none -q "$@" </dev/null
        awk -v fields="psnr fit_seconds ssim" -f "$here/result.awk" "$scratch/log.json"
    done | awk '{ p += $1; s += $2; q += $3 } END { printf "%.4f %.4f %.4f\n", p / NR, s / NR, q / NR }'
}

# Options of all moves from number $1 on, which are not made yet.
without() {
    local i
    for ((i = $1; i < ${#moves[@]}; i++)); do echo "${moves[i]#*|}"; done
}

# Steps and seconds to the quality, between two rungs by the logarithm of both; the last rung where it is not reached.
climb() { # PROJECT PSNR OPTION...
    local project=$1 target=$2 steps rung rungs=
    shift 2
    for steps in "${ladder[@]}"; do
        rung="$steps $(fit "$project" "$steps" "$@")"
        rungs+=$rung$'\n'
        awk -v target="$target" '{ exit $2 < target }' <<<"$rung" && break
    done
    printf %s "$rungs" | awk -v target="$target" '
        { was_steps = steps; was_psnr = psnr; was_seconds = seconds; steps = $1; psnr = $2; seconds = $3 }
        END {
            part = NR > 1 && psnr >= target ? (psnr - target) / (psnr - was_psnr) : 0
            printf "%.0f %.3f %.3f\n", part ? steps * (was_steps / steps) ^ part : steps,
                part ? seconds * (was_seconds / seconds) ^ part : seconds, part ? target : psnr
        }'
}

cumulative() { # SCENE PROJECT
    local i options psnr seconds row
    read -r psnr seconds _ < <(
        # shellcheck disable=SC2046
        fit "$2" $reference $(without 0)
    )
    {
        printf '[\n {"move": "none", "seconds": %s, "steps": %s, "psnr": %s}' "$seconds" "$reference" "$psnr"
        for ((i = 1; i <= ${#moves[@]}; i++)); do
            options=$(without "$i")
            # shellcheck disable=SC2086
            row=$(climb "$2" "$psnr" $options)
            echo "$1: + ${moves[i - 1]%%|*}: $row" >&2
            read -r -a row <<<"$row"
            printf ',\n {"move": "+ %s", "seconds": %s, "steps": %s, "psnr": %s}' "${moves[i - 1]%%|*}" "${row[1]}" "${row[0]}" \
                "${row[2]}"
        done
        printf '\n]\n'
    } >"$scratch/moves.json"
    mv "$scratch/moves.json" "$dir/schedule-$1.json"
}

leave_one_out() { # SCENE PROJECT
    local length move row
    for length in "${lengths[@]}"; do
        echo "| $1, $length steps | $(fit "$2" "$length" | awk '{ printf "%.2f | %.1f | %.3f", $1, $2, $3 }') |"
        for move in "${moves[@]}"; do
            # shellcheck disable=SC2086
            row=$(fit "$2" "$length" ${move#*|} | awk '{ printf "%.2f | %.1f | %.3f", $1, $2, $3 }')
            echo "| without ${move%%|*} | $row |"
        done
    done
}

{
    echo "| fit | PSNR, dB | seconds | SSIM |"
    echo "| --- | --- | --- | --- |"
} >"$scratch/moves.md"
for scene in $scenes; do
    case $scene in
    fox) project=${SPLATFIT_DATA:-none}/fox-centred-270 ;;
    *) project=$studio ;;
    esac
    case $project in sim:*) ;; *) [ -d "$project" ] || continue ;; esac
    cumulative "$scene" "$project"
    leave_one_out "$scene" "$project" | tee -a "$scratch/moves.md" >&2
done
mv "$scratch/moves.md" "$dir/moves.md"
