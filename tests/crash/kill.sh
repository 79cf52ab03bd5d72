#!/bin/bash
# kill.sh - fits that are killed at any moment and gone on with: there is always a whole
# checkpoint and a whole model, and the last model is, to the byte, that of a fit that nobody killed.
#
# KILLS             how many (10)
# SEED              of the moments (1)
# SPLATFIT_PROGRAM  the program (build/splatfit)
# RUN               runs a program of another machine here
set -u

# An emulated fit takes long: there are fewer.
if [ -n "${SPLATFIT_QUICK:-}" ]; then few=3 steps=40; else few=10 steps=150; fi
kills=${KILLS:-$few} seed=${SEED:-1}
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM
RANDOM=$seed
# RUN is a command and its arguments.
# shellcheck disable=SC2206
program=(${RUN:-} "$(realpath "${SPLATFIT_PROGRAM:-build/splatfit}")")
scene='sim:studio?width=64&height=48&frames=9'
cd "$scratch" || exit 1

seconds() { date +%s.%N; }

fit() { # MODEL CHECKPOINT OPTION...
    local model=$1 checkpoint=$2
    shift 2
    exec "${program[@]}" fit "$scene" --max-gaussians 300 --densify-every 10 --validate 4 --exposure -o "$model" \
        --checkpoint "$checkpoint" --checkpoint-every 0 --threads 2 --quiet "$@"
}

# What --resume needs, once there is a checkpoint.
options() {
    if [ -e run.fit ]; then echo --resume run.fit; else echo --steps "$steps"; fi
}

failures=()
fail() {
    echo "kill $killed (of $kills, seed $seed): $1"
    failures+=("$1")
}

same() { cmp -s "$1" "$2"; }

# What is there after a moment of which nothing is known.
check() {
    if [ -e had ] && [ ! -e run.fit ]; then fail "the checkpoint is gone"; fi
    if [ -e run.fit ]; then : >had; fi
    same run.ply old.ply || same run.ply expected.ply || fail "the model is neither the old one nor the new one"
    # one of each file at most: the next writer takes the others away
    [ "$(find . -name '.*.tmp' | wc -l)" -le 3 ] || fail "half-written files pile up"
}

# A run came to its end.
check_whole() {
    same run.ply expected.ply || fail "the model differs from that of a fit that was not killed"
    [ -z "$(find . -name '.*.tmp')" ] || fail "half-written files are left after a whole run"
    whole=$((whole + 1))
    rm -f run.fit had
    cp old.ply run.ply
}

killed=0 whole=0
(fit old.ply old.fit --steps 5 --seed 7) || fail "the first fit fails"
began=$(seconds)
(fit expected.ply expected.fit --steps "$steps") || fail "the fit that nobody kills fails"
span=$(awk -v a="$began" -v b="$(seconds)" 'BEGIN { print (b - a) / 3 }')
cp old.ply run.ply
while [ "$killed" -lt "$kills" ] && [ ${#failures[@]} = 0 ]; do
    # shellcheck disable=SC2046
    (fit run.ply run.fit $(options)) >said 2>&1 &
    pid=$!
    sleep "$(awk -v s="$span" -v r="$RANDOM" 'BEGIN { print s * r / 32768 }')"
    kill -9 $pid 2>/dev/null
    wait $pid 2>/dev/null
    status=$?
    case $status in
    137)
        killed=$((killed + 1))
        check
        ;;
    0) check_whole ;;
    *) fail "it ends by itself with $status: $(tail -n 1 said)" ;;
    esac
done
# shellcheck disable=SC2046
(fit run.ply run.fit $(options)) >said 2>&1 || fail "it cannot go on: $(tail -n 1 said)"
check_whole
echo "killed $killed times, $whole whole runs"
echo 1..1
if [ ${#failures[@]} = 0 ]; then echo "ok 1 - killed"; else echo "not ok 1 - killed"; fi
