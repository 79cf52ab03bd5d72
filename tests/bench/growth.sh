#!/bin/bash
# growth.sh DIR [quick] - what the ways to grow reach: DIR/growth.md, a table.
#
# One fit after another of one thread each, by steps, so that what else the machine does changes nothing but the time. A
# fit whose log is in DIR already is not made again.
#
# PROGRAM, RUN: as for charts.sh. TUNE: a project to choose on; its held-out views must be nobody's test. FITS: which rows,
# a pattern. SEEDS: which.
set -euo pipefail

dir=$1
kind=${2:-full}
program=${PROGRAM:-build/splatfit}
here=$(dirname "$0")
mkdir -p "$dir"

# A fit: scene, length, way to grow.
lengths=('short|--steps 825 --max-gaussians 30000' 'default|--steps 3000'
    'long|--steps 6000 --max-gaussians 80000 --lr-mean 3.2e-4')
reg='--reg-opacity 0.01 --reg-scale 0.01'
ways=('gradient|' 'error|--densify error' 'relocate|--densify relocate' "gradient, regularised|$reg"
    "relocate, regularised|--densify relocate $reg" 'relocate, a tenth of the noise|--densify relocate --relocate-noise 5e4')
seeds=${SEEDS:-1 2 3}
studio=sim:studio
if [ "$kind" = quick ]; then
    lengths=('short|--steps 30 --max-gaussians 600') seeds=1
    studio='sim:studio?width=80&height=60&frames=20'
fi

run() { # LOG PROJECT OPTION...
    local log=$1 project=$2 TIMEFORMAT=%U
    shift 2
    [ -s "$log.cpu" ] && return
    { time ${RUN:-} "$program" fit "$project" -o /dev/null --cameras none --validate 0 --size cap --densify-per-step 13 --threads 1 --log "$log" --progress none -q "$@" \
        </dev/null >/dev/null 2>&1; } 2>"$log.time"
    mv "$log.time" "$log.cpu"
}

{
    echo "| scene, length, growth | PSNR by seed, dB | SSIM | Gaussians | ms of one thread a step | needles |"
    echo "| --- | --- | --- | --- | --- | --- |"
    for scene in ${TUNE:+tune} studio; do
        project=$studio
        [ "$scene" = studio ] || project=$TUNE
        for length in "${lengths[@]}"; do
            [ "$kind" = full ] && [ "$scene" = studio ] && [ "${length%%|*}" != default ] && continue
            for way in "${ways[@]}"; do
                name="$scene, ${length%%|*}, ${way%%|*}"
                # shellcheck disable=SC2053
                [[ $name == ${FITS:-*} ]] || continue
                for seed in $seeds; do
                    log="$dir/${name//, /-}.$seed.json"
                    log=${log// /-}
                    # shellcheck disable=SC2086
                    run "$log" "$project" --seed "$seed" ${length#*|} ${way#*|}
                    echo "$(awk -v fields="psnr ssim gaussians steps needles" -f "$here/result.awk" "$log") $(cat "$log.cpu")"
                done | awk -v name="$name" '
                    { psnr = psnr (NR > 1 ? ", " : "") sprintf("%.2f", $1); ssim += $2; n += $3; ms += 1000 * $6 / $4; needles += 100 * $5 }
                    END { printf "| %s | %s | %.4f | %d | %.1f | %.2f %% |\n", name, psnr, ssim / NR, n / NR, ms / NR, needles / NR }'
            done
        done
    done
} >"$dir/growth.part"
mv "$dir/growth.part" "$dir/growth.md"
