#!/bin/bash
# completion.sh - what bash offers after a few beginnings of a command line.
set -u
# shellcheck source=tests/app/tap.sh
. "$(dirname "$0")/tap.sh"
# shellcheck source=src/app/man/completion.bash
. src/app/man/completion.bash

if [ -n "${RUN:-}" ]; then
    skip completion "emulated: the completion starts the program itself"
    finish
    exit
fi

# offers WORD...: the words before the cursor, the last one unfinished; what is offered, a line each
offers() {
    COMP_WORDS=("$program" "$@")
    COMP_CWORD=$#
    COMPREPLY=()
    _splatfit 2>/dev/null
    printf '%s\n' "${COMPREPLY[@]}"
}
has() { # WHAT WORD...
    local what=$1
    shift
    offers "$@" | grep -qxF -e "$what" || { echo "after $*: not $what but: $(offers "$@" | xargs)"; return 1; }
}
only() { # WHAT WORD...: nothing else either
    local what=$1
    shift
    [ "$(offers "$@" | sort | xargs)" = "$what" ] || { echo "after $*: $(offers "$@" | sort | xargs)"; return 1; }
}

touch "$scratch/a.ply" "$scratch/b.spz" "$scratch/c.txt"
mkdir "$scratch/project"
check "commands" only "calibrate cameras capture" ca
check "options of a command" only "--checkpoint --checkpoint-every" fit --checkp
check "hyperparameters" has --lr-mean-final fit --lr-m
check "values of an option" only "draft high standard" fit --preset ''
check "the beginning of a value" only plain fit --progress pl
check "a value behind =" only "cap" fit --size = c
check "values of a hyperparameter" has relocate fit --densify re
check "levels of this machine" has scalar render m.ply p --isa s
check "files" has "$scratch/c.txt" fit x --log "$scratch/c"
check "models alone for --from" only "$scratch/a.ply $scratch/b.spz $scratch/project" fit --from "$scratch/"
check "folders alone" only "$scratch/project" render --out "$scratch/"
check "the simulated scene" has sim:studio fit si
check "sources" has v4l2: capture v4
check "help" has convert help con
check "no option of another command" only "" eval --checkp
check "nothing for an unknown command" only "" nonsense --
finish
