# shellcheck shell=bash
# completion.bash - what bash completes after "splatfit": the program itself says what its tables hold.

_splatfit_words() { # WORD...: those that begin as the one at the cursor does
    mapfile -t COMPREPLY < <(compgen -W "$*" -- "$cur")
}

_splatfit_files() { # PATTERN: folders, and files whose names match, or all
    local IFS=$'\n'
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -d -- "$cur"; compgen -f -- "$cur" | grep -E "${1:-.}" | while read -r name; do
        [ -d "$name" ] || printf '%s\n' "$name"
    done)
}

# The value of an option, by what its help calls it.
_splatfit_value() { # METAVAR
    case $1 in
    *'|'*) _splatfit_words "${1//|/ }" ;;
    MODEL) _splatfit_files '\.(ply|spz|splat)$' ;;
    WHERE) _splatfit_files '\.y4m$' ;;
    FILE | PATH | FROM) _splatfit_files ;;
    DIR) mapfile -t COMPREPLY < <(compgen -d -- "$cur") && compopt -o filenames 2>/dev/null ;;
    *) COMPREPLY=() ;;
    esac
}

_splatfit() {
    local program=${COMP_WORDS[0]} cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]}
    local command=${COMP_WORDS[1]} option metavar words
    # --name=value comes in three words.
    if [ "$cur" = = ]; then cur=; elif [ "$prev" = = ]; then prev=${COMP_WORDS[COMP_CWORD - 2]}; fi
    COMPREPLY=()
    if [ "$COMP_CWORD" = 1 ] || { [ "$COMP_CWORD" = 2 ] && [ "$command" = help ]; }; then
        _splatfit_words "$("$program" help --words 2>/dev/null | if [ "$COMP_CWORD" = 2 ]; then grep -v -e - -e help; else cat; fi)"
        return
    fi
    words=$("$program" help --words "$command" 2>/dev/null) || return
    while read -r option metavar; do
        if [ "$option" = "$prev" ] && [ -n "$metavar" ]; then
            _splatfit_value "$metavar"
            return
        fi
    done <<<"$words"
    if [[ $cur == -* ]]; then
        _splatfit_words "$(cut -d ' ' -f 1 <<<"$words" | grep '^--')"
        return
    fi
    case $command in
    fit | info | render | eval | convert | prune)
        _splatfit_files
        if [[ -n $cur && sim:studio == "$cur"* ]]; then COMPREPLY+=(sim:studio); fi
        ;;
    calibrate | capture | live) _splatfit_words 'v4l2: libcamera: folder: pipe:- sim:studio sim:studio-board sim:corridor' ;;
    *) _splatfit_files ;;
    esac
}
complete -F _splatfit splatfit
