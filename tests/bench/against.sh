#!/bin/bash
# against.sh OLD [quick] - this build's program beside OLD, another build's: both make the same fits in turn, and what is printed is a
# table of medians and of their ratios, new / old.
#
# Seconds and memory are medians over the runs; Gaussians, PSNR and SSIM of the held-out views are means, for each run has a seed
# of its own, the same for both programs. The ratios of seconds of two programs in turn are worth more than their seconds.
# Only options that programs of 0.1.0 have are used. quick: one small fit, whether it works.
#
# RUNS      of each fit by each program (5)
# SEEDS     of the runs, taken in turn (1 2 3 ...)
# PRESETS   draft and standard if unset
# SCENES    which of studio, fox and tagboard, or projects; if unset all that are there
# THREADS   2 if unset
# PROGRAM, RUN, SPLATFIT_DATA: as for charts.sh
set -euo pipefail
export LC_ALL=C

old=${1:-}
kind=${2:-full}
new=${PROGRAM:-build/splatfit}
data=${SPLATFIT_DATA:-none}
here=$(dirname "$0")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

fail() {
    echo "against.sh: $*" >&2
    exit 1
}
[ -n "$old" ] || fail 'AGAINST is not set: make bench PARTS=against AGAINST=../before/build/splatfit names the program of another build'
for program in "$old" "$new"; do
    [ -f "$program" ] || fail "$program: there is no such program; AGAINST names the program of another build, as ../before/build/splatfit"
    # RUN is a command and its arguments.
    # shellcheck disable=SC2086
    ${RUN:-} "$program" --version >"$scratch/version" 2>&1 || fail "$program: does not run here: $(tail -n 1 "$scratch/version")"
done

runs=${RUNS:-5} presets=${PRESETS:-draft standard} scenes=${SCENES:-studio fox tagboard} options=()
if [ "$kind" = quick ]; then
    runs=${RUNS:-1} presets=draft scenes='sim:studio?width=80&height=60&frames=20'
    options=(--steps 40 --max-gaussians 1000)
fi
[[ $runs =~ ^[1-9][0-9]*$ ]] || fail "RUNS: \"$runs\" is no number of runs"
read -r -a seeds <<<"${SEEDS:-$(seq -s ' ' "$runs")}"

# wall and user seconds of a fit, then what its log says.
TIMEFORMAT='%R %U'
fields='fit_seconds peak_memory_mb gaussians psnr ssim'
fit() { # PROGRAM PROJECT PRESET SEED
    # shellcheck disable=SC2086
    { time ${RUN:-} "$1" fit "$2" --preset "$3" --seed "$4" --threads "${THREADS:-2}" --cameras none -o "$scratch/model.ply" \
        --log "$scratch/log.json" --progress none -q "${options[@]}" >"$scratch/said" 2>&1 </dev/null; } 2>"$scratch/time" ||
        fail "$1 fit $2 --preset $3: failed: $(tail -n 1 "$scratch/said")"
    local line
    line="$(cat "$scratch/time") $(awk -v fields="$fields" -f "$here/result.awk" "$scratch/log.json")"
    [ "$(wc -w <<<"$line")" = 7 ] || fail "$1: the log of fit $2 lacks one of: $fields"
    echo "$line"
}

# The seconds of both programs in the order that they ran in: who is first changes with each run.
compare() { # PROJECT PRESET
    local run seed
    : >"$scratch/old"
    : >"$scratch/new"
    for ((run = 0; run < runs; run++)); do
        seed=${seeds[run % ${#seeds[@]}]}
        if ((run % 2)); then
            fit "$new" "$1" "$2" "$seed" >>"$scratch/new"
            fit "$old" "$1" "$2" "$seed" >>"$scratch/old"
        else
            fit "$old" "$1" "$2" "$seed" >>"$scratch/old"
            fit "$new" "$1" "$2" "$seed" >>"$scratch/new"
        fi
    done
}

table() { # NAME
    awk -v name="$1" '
        { value[FNR == NR, FNR] = $0; n = FNR }
        function sorted_middle(v, i, k, x) {
            for (i = 2; i <= n; i++)
                for (k = i; k > 1 && v[k - 1] > v[k]; k--) { x = v[k]; v[k] = v[k - 1]; v[k - 1] = x }
            return n % 2 ? v[(n + 1) / 2] : (v[n / 2] + v[n / 2 + 1]) / 2
        }
        function of_all(old, field, mean, i, part, v, sum) {
            for (i = 1; i <= n; i++) { split(value[old, i], part, " "); v[i] = part[field] + 0; sum += v[i] }
            return mean ? sum / n : sorted_middle(v)
        }
        function row(what, field, mean, form, difference, a, b) {
            a = of_all(1, field, mean)
            b = of_all(0, field, mean)
            change = difference ? sprintf("%+.4f", b - a) : (a > 0 ? sprintf("%.3f", b / a) : "-")
            printf "| %s | %s | " form " | " form " | %s |\n", name, what, a, b, change
        }
        END {
            row("seconds, all", 1, 0, "%.2f", 0)
            row("seconds, steps", 3, 0, "%.2f", 0)
            row("user seconds", 2, 0, "%.2f", 0)
            row("peak memory, MB", 4, 0, "%.1f", 0)
            row("Gaussians", 5, 1, "%.0f", 0)
            row("PSNR, dB", 6, 1, "%.3f", 1)
            row("SSIM", 7, 1, "%.4f", 1)
        }' "$scratch/old" "$scratch/new"
}

echo "old: $old"
echo "new: $new"
echo
echo "${THREADS:-2} threads, $runs runs of each in turn, seeds ${seeds[*]}; PSNR and SSIM of held-out views: differences"
echo
echo "| fit | median, or mean over the seeds | old | new | new / old |"
echo "| --- | --- | --- | --- | --- |"
for scene in $scenes; do
    case $scene in
    studio) project=sim:studio ;;
    fox) project=$data/fox-centred-270 ;;
    tagboard) project=$data/rbt-tagboard ;;
    *) project=$scene ;;
    esac
    case $project in "$data"/*) [ -d "$project" ] || continue ;; esac
    for preset in $presets; do
        compare "$project" "$preset"
        table "${scene##*/}, $preset"
    done
done
