#!/bin/sh
# charts.sh DIR [quick] - a fixed set of fits, their logs in DIR, and DIR/index.html with the charts of them.
#
# Logs of an earlier run are replaced; other .json in DIR, as ablations, are drawn too.
#
# PROGRAM        the program, build/splatfit if unset
# RUN            runs it, where it is another machine's
# SPLATFIT_DATA  the folder of real scenes; without it only the simulated one
# PARTS          which of fits, moves and sizes; all of them if unset
set -eu

dir=$1
kind=${2:-full}
parts=${PARTS:-fits moves sizes}
program=${PROGRAM:-build/splatfit}
data=${SPLATFIT_DATA:-none}
moments=0.1,0.2,0.5,1,1.5,2,3,4,5,7,10,15,20,30,45,60,90,120,180,240,300,450,600
mkdir -p "$dir"

# A fit a row: which set it belongs to, the scene and its project (DATA: SPLATFIT_DATA), seeds, levels (native: the
# best one here; those that this machine lacks are left out), what the chart calls it, options.
#
# full: the fits take some 45 min with the real scenes on two idle cores, moves and sizes come on top; quick: seconds.
rows() {
    cat <<'END'
full  studio   sim:studio                              1,2,3,4,5 native           standard    --preset standard
full  studio   sim:studio                              1,2,3,4,5 native           draft       --preset draft
full  studio   sim:studio                              1         native           high        --preset high
full  studio   sim:studio                              1         avx2,sse4,scalar draft       --preset draft
full  studio   sim:studio                              1         native           20 s        --time-limit 20 --max-gaussians 40000
full  fox      DATA/fox-centred-270                    1,2,3,4,5 native           standard    --preset standard
full  fox      DATA/fox-centred-270                    1,2,3,4,5 native           draft       --preset draft
full  fox      DATA/fox-centred-270                    1         native           high        --preset high
full  fox      DATA/fox-centred-270                    1         avx2,sse4,scalar draft       --preset draft
full  fox      DATA/fox-centred-270                    1         native           5 s         --time-limit 5 --max-gaussians 40000
full  fox      DATA/fox-centred-270                    1         native           60 s        --time-limit 60 --size cap --max-gaussians 82000
full  tagboard DATA/rbt-tagboard                       1,2,3,4,5 native           standard    --preset standard
full  tagboard DATA/rbt-tagboard                       1,2,3     native           draft       --preset draft
full  tagboard DATA/rbt-tagboard                       1         native           high        --preset high
quick studio   sim:studio?width=80&height=60&frames=20 1,2       native           60 steps    --steps 60 --max-gaussians 1000
quick studio   sim:studio?width=80&height=60&frames=20 1         scalar           60 steps    --steps 60 --max-gaussians 1000
END
}

# RUN is a command and its arguments.
# shellcheck disable=SC2086
splatfit() { ${RUN:-} "$program" "$@"; }

best=$(splatfit info --cpu | awk '$2 " " $3 == "in use" { print $1 }')
has() { splatfit info --cpu | awk -v name="$1" '$1 == name && $2 != "not" { found = 1 } END { exit !found }'; }

# Options are words.
# shellcheck disable=SC2086
fit() { # NAME PROJECT LEVEL SEED LABEL OPTION...
    name=$1-$3-$4 project=$2 level=$3 seed=$4 label=$5
    shift 5
    snapshots=
    [ "$seed $level" != "1 $best" ] || snapshots="--snapshots $dir/$name"
    echo "fitting: $name"
    splatfit fit "$project" -o /dev/null --isa "$level" --seed "$seed" --label "$label, $level" \
        --log "$dir/$name.json" --eval-at $moments $snapshots --progress none -q "$@"
}

list=$(mktemp)
trap 'rm -f "$list"' EXIT
rows | sed 's/  */ /g' | grep "^$kind " >"$list"
number=0
case $parts in *fits*) rm -rf "$dir"/fit-* ;; *) : >"$list" ;; esac
while read -r _ scene project seeds levels rest; do
    number=$((number + 1))
    case $project in DATA/*) project=$data/${project#DATA/} ;; esac
    case $project in sim:*) ;; *) [ -d "$project" ] || continue ;; esac
    label=${rest%% --*}
    options=${rest#"$label "}
    for level in $(echo "$levels" | tr , ' '); do
        [ "$level" != native ] || level=$best
        # The best level has its rows of its own.
        case $levels in *,*) [ "$level" != "$best" ] || continue ;; esac
        has "$level" || continue
        for seed in $(echo "$seeds" | tr , ' '); do
            # shellcheck disable=SC2086
            fit "fit-$number-$scene" "$project" "$level" "$seed" "$label" $options </dev/null
        done
    done
done <"$list"
for part in moves sizes; do
    case $parts in *$part*) "$(dirname "$0")/$part.sh" "$dir" "$kind" ;; esac
done
splatfit chart "$dir"/*.json --out "$dir"
