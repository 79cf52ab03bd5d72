#!/bin/sh
# sizes.sh DIR [quick] - what size is worth: logs in DIR of fits with caps that are multiples of one, of fits that choose
# their number, and of one large fit pruned by worth and at random. `splatfit chart DIR/*.json` draws them.
#
# By steps, so that what else the machine does changes nothing; over three seeds, for one alone strays by more than what the
# knee is told by. Logs of an earlier run are replaced.
#
# PROGRAM, RUN, SPLATFIT_DATA: as for charts.sh. SIZED: which of fox, tagboard and studio.
set -eu

dir=$1
kind=${2:-full}
program=${PROGRAM:-build/splatfit}
data=${SPLATFIT_DATA:-none}
mkdir -p "$dir"
rm -f "$dir"/size-*.json
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# The caps in eighths of `base`, up to what a fit may have if nothing is said; the fit with the whole of it is the one
# that is pruned.
scenes=${SIZED:-fox tagboard studio}
studio=sim:studio base=60000 eighths='1 2 4 6 8 12 16 20' steps=3000 seeds='1 2 3'
if [ "$kind" = quick ]; then
    scenes=studio studio='sim:studio?width=80&height=60&frames=20' base=400 eighths='2 4 8' steps=40 seeds=1
fi

# RUN is a command and its arguments.
# shellcheck disable=SC2086
splatfit() { ${RUN:-} "$program" "$@" </dev/null; }

fit() { # LOG PROJECT OPTION...
    log=$dir/size-$1.json project=$2
    shift 2
    echo "fitting: ${log##*/}"
    splatfit fit "$project" -o "$scratch/model.ply" --cameras none --steps $steps --log "$log" --eval-train --progress none -q "$@"
}

prune() { # LOG PROJECT OPTION...
    log=$dir/size-$1.json project=$2
    shift 2
    echo "pruning: ${log##*/}"
    splatfit prune "$scratch/whole.ply" "$project" -o "$scratch/model.ply" --log "$log" -q "$@"
}

for scene in $scenes; do
    case $scene in
    fox) project=$data/fox-centred-270 ;;
    tagboard) project=$data/rbt-tagboard ;;
    *) project=$studio ;;
    esac
    case $project in sim:*) ;; *) [ -d "$project" ] || continue ;; esac
    for seed in $seeds; do
        for n in $eighths; do
            fit "$scene-cap-$n-$seed" "$project" --label caps --size cap --densify-per-step 1e6 --max-gaussians $((base * n / 8)) --seed "$seed"
            [ "$n $seed" != "8 1" ] || mv "$scratch/model.ply" "$scratch/whole.ply"
        done
        fit "$scene-auto-$seed" "$project" --label auto --size auto --seed "$seed"
    done
    prune "$scene-pruned-loss" "$project" --loss 0.1dB
    for n in $eighths; do
        [ "$n" -lt 8 ] || continue
        prune "$scene-pruned-$n" "$project" --to $((base * n / 8))
        prune "$scene-random-$n" "$project" --to $((base * n / 8)) --random
    done
done
