#!/bin/bash
# install.sh - installs into a scratch folder and builds and runs tests/examples against that, by pkg-config alone: with
# the shared library, with the static one, from Python; and what else was installed.
set -euo pipefail

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
prefix=$scratch/usr
make=("${MAKE:-make}" --no-print-directory -s)
"${make[@]}" install PREFIX="$prefix"

export PKG_CONFIG_PATH="$prefix/lib/pkgconfig"
version=$(pkg-config --modversion splatfit)
fail() {
    echo "install.sh: $*"
    exit 1
}
expect() { # WHAT COMMAND...: the command succeeds and its output has WHAT in it
    local what=$1 said
    shift
    said=$("$@" 2>&1) || fail "$*: failed: $said"
    [[ $said == *"$what"* ]] || fail "$*: does not say \"$what\": $said"
}
is_picture() { # FILE
    local colours
    [ -s "$1" ] || fail "$1: is not there"
    colours=$(python3 -c 'import sys; print(len(set(open(sys.argv[1], "rb").read())))' "$1" 2>/dev/null || echo 99)
    [ "$colours" -gt 16 ] || fail "$1: shows nothing"
}

# build LINK...: each example as LINK says
build() {
    local source name
    for source in tests/examples/*.c; do
        name=$(basename "$source" .c)
        # What pkg-config prints are words.
        # shellcheck disable=SC2046
        ${CC:-gcc} -std=c11 -Wall -Wextra -Werror $(pkg-config --cflags splatfit) "$source" $(pkg-config "$@" splatfit) -lm \
            -o "$scratch/$name"
    done
}
run_all() { # KIND
    local out=$scratch/$1
    mkdir "$out"
    expect "step 100," "$scratch/fit_folder" 'sim:studio?width=64&height=48&frames=9' "$out/studio.ply" 100
    expect "Gaussians" "$scratch/feed_frames" "$out/fed.spz" 20
    expect "" "$scratch/render_circle" "$out/studio.ply" "$out" 3
    is_picture "$out/002.png"
    if "$scratch/fit_folder" nowhere "$out/no.ply" 2>"$out/said"; then fail "fit_folder: fits what is not there"; fi
    grep -q 'nowhere' "$out/said" || fail "fit_folder: does not name the project: $(cat "$out/said")"
    [ ! -e "$out/no.ply" ] || fail "fit_folder: leaves a model behind"
}

build --libs
export LD_LIBRARY_PATH=$prefix/lib
objdump -p "$scratch/fit_folder" | grep -q "NEEDED *libsplatfit.so.[0-9]*$" || fail "fit_folder: not linked with the shared library"
run_all shared
if command -v python3 >/dev/null; then
    expect "splatfit $version" python3 tests/examples/render.py "$scratch/shared/studio.ply" "$scratch/studio.ppm"
    is_picture "$scratch/studio.ppm"
    if python3 tests/examples/render.py nowhere "$scratch/no.ppm" 2>"$scratch/said"; then fail "render.py: renders nothing"; fi
    grep -q nowhere "$scratch/said" || fail "render.py: does not name the model: $(cat "$scratch/said")"
fi

# The README shows the lines of snippet.c.
sed -n '/README: begin/,/README: end/{//!s/^    //p}' tests/examples/snippet.c >"$scratch/snippet"
grep -c . "$scratch/snippet" >/dev/null || fail "snippet.c: nothing between its marks"
sed -n 's/^    //p' README.md | grep -Fxf "$scratch/snippet" | cmp -s - "$scratch/snippet" ||
    fail "README.md: does not show the lines between the marks of tests/examples/snippet.c"

unset LD_LIBRARY_PATH
rm "$prefix"/lib/libsplatfit.so*
build --static --libs
run_all static
expect "$version" "$prefix/bin/splatfit" --version

for file in man/man1/splatfit.1 man/man1/splatfit-fit.1 bash-completion/completions/splatfit; do
    [ -s "$prefix/share/$file" ] || fail "share/$file: was not installed"
done
"${make[@]}" uninstall PREFIX="$prefix"
left=$(find "$prefix" ! -type d)
[ -z "$left" ] || fail "make uninstall leaves $left"
