#!/bin/bash
# test.sh ARCH ROOT FOLDER - the packages of FOLDER install, run and go.
#
# With a ROOT, the libraries of a foreign machine: they are unpacked into a copy of it and run by RUN, an emulator.
# Without: dpkg installs them into a root with this system's list of packages, so that what they depend on is checked, and
# removes them.
set -euo pipefail

arch=$1 root=$2 folder=$3
work=$(mktemp -d -p "$folder")
trap 'rm -rf "$work"' EXIT
fail() {
    echo "test.sh: $arch: $*"
    exit 1
}
packages=("$folder"/*_"${VERSION}_$arch".deb)
wanted=3
[ -z "${MPI:-}" ] || wanted=4
[ ${#packages[@]} = $wanted ] || fail "there are ${#packages[@]} packages, not $wanted"
for package in "${packages[@]}"; do
    [ "$(dpkg-deb -f "$package" Architecture)" = "$arch" ] || fail "$package: is of another architecture"
done

if [ -n "$root" ]; then
    # Links to its files: unpacking replaces names, never contents.
    cp -al "$root/." "$work/root"
    for package in "${packages[@]}"; do
        dpkg-deb --fsys-tarfile "$package" | tar -x --keep-directory-symlink --no-same-owner -C "$work/root"
    done
    for package in "${packages[@]}"; do
        for name in $(dpkg-deb -f "$package" Depends | sed 's/([^)]*)//g; s/,/ /g'); do
            [ -d "$work/root/usr/share/doc/$name" ] || fail "$package: depends on $name, which is neither in $root nor made here"
        done
    done
else
    mkdir -p "$work/root/var/lib/dpkg/updates" "$work/root/var/lib/dpkg/info"
    cp /var/lib/dpkg/status "$work/root/var/lib/dpkg/"
    dpkg_there() { dpkg --root="$work/root" --force-not-root --force-script-chrootless --no-triggers --log=/dev/null "$@"; }
    dpkg_there -i "${packages[@]}" >"$work/said" 2>&1 || fail "dpkg -i: $(cat "$work/said")"
fi

# Started by the loader of the root, which finds the libraries there, or by this system's.
splatfit() { ${RUN_IN:+$RUN_IN "$work/root"} "$work/root/usr/bin/splatfit" "$@" </dev/null; }
[[ $(splatfit --version) == "splatfit $VERSION" ]] || fail "splatfit --version: $(splatfit --version 2>&1)"
splatfit fit 'sim:studio?width=64&height=48&frames=9' --steps 3 --max-gaussians 400 --quiet -o "$work/model.ply" ||
    fail "splatfit fit: fails"
[ "$(head -c 3 "$work/model.ply")" = ply ] || fail "splatfit fit: writes no model"
for kind in ${MPI:-}; do
    ${RUN_IN:+$RUN_IN "$work/root"} "$work/root/usr/bin/splatfit-$kind" info --build >"$work/build" || fail "splatfit-$kind info --build: fails"
    grep -qE '^(ompi-c|mpich) +[0-9]' "$work/build" || fail "splatfit-$kind: $(cat "$work/build")"
    zcat "$work/root/usr/share/man/man1/splatfit-$kind.1.gz" | grep -q '^.SH HOSTS' || fail "splatfit-$kind: has no page of the manual"
done
man=$work/root/usr/share/man/man1/splatfit-fit.1.gz
zcat "$man" | grep -q '^.SH OPTIONS' || fail "$man: is no page of the manual"
grep -q 'libspng *BSD-2-Clause' "$work/root/usr/share/doc/splatfit/copyright" || fail "copyright: does not name libspng"
bash -n "$work/root/usr/share/bash-completion/completions/splatfit" || fail "the completion is no bash"

if [ -z "$root" ]; then
    dpkg_there --purge splatfit ${MPI:+splatfit-mpi} libsplatfit-dev "libsplatfit$SOVERSION" >"$work/said" 2>&1 || fail "dpkg --purge: $(cat "$work/said")"
    left=$(find "$work/root/usr" -type f 2>/dev/null || true)
    [ -z "$left" ] || fail "dpkg --purge: leaves $left"
fi
if command -v lintian >/dev/null; then
    # Nobody's address; no bug to close.
    lintian --allow-root --fail-on error --suppress-tags bogus-mail-host,malformed-contact,initial-upload-closes-no-bugs,unstripped-static-library \
        "${packages[@]}" >"$work/said" 2>&1 || fail "lintian: $(cat "$work/said")"
    grep -v '^N:' "$work/said" || true
fi
echo "test.sh: $arch: ${#packages[@]} packages install and run$([ -n "$root" ] || echo ', and go')"
