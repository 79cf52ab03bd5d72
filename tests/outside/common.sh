# shellcheck shell=bash
# common.sh - what the tests with programs of others share: counts of checks, what npm installs, ours.
# To be sourced, with `name` set to what is tested.
#
# RUN      runs a program of another machine here
# PROGRAM  the program
program=$(realpath "${PROGRAM:-build/splatfit}")
passed=0 failed=0 skipped=0

finish() {
    echo "$passed passed, $failed failed, $skipped skipped"
    [ $failed = 0 ]
    exit
}

check() { # NAME COMMAND...
    local what=$1 said
    shift
    if said=$("$@" 2>&1); then
        passed=$((passed + 1))
        printf 'passed  %s%s\n' "$what" "${SAY:+: $said}"
    else
        failed=$((failed + 1))
        printf 'FAILED  %s\n%s\n' "$what" "$said"
    fi
}

skip_all() { # WHY
    skipped=1
    # shellcheck disable=SC2154
    printf 'SKIPPED %s: %s\n' "$name" "$1"
    finish
}

# Packages of npm's into a folder, once; sets `interpreter` to a node that is new enough for them.
install() { # FOLDER PACKAGE@VERSION...
    local dir=$1 stamp
    shift
    command -v npm >/dev/null || skip_all 'npm is not installed'
    mkdir -p "$dir"
    stamp=$dir/.$(echo "$*" | tr -c 'a-zA-Z0-9.\n' -)
    if ! [ -e "$stamp" ]; then
        (cd "$dir" && npm install --no-audit --no-fund --no-package-lock --prefix . "$@" node@22) >"$dir/npm.log" 2>&1 ||
            skip_all "npm cannot install it: $(tail -n 1 "$dir/npm.log")"
        touch "$stamp"
    fi
    # The package "node" brings its program by a script that npm may be told not to run.
    interpreter=$dir/node_modules/node/bin/node
    [ -x "$interpreter" ] || interpreter=$(command -v node) || skip_all 'there is no node'
}

# RUN is a command and its arguments.
# shellcheck disable=SC2086,SC2317
ours() { ${RUN:-} "$program" "$@"; }
