#!/bin/sh
# sysroot.sh ARCH DIR - makes in DIR a root of Debian's libraries for ARCH (amd64, arm64, armhf), to build
# against and to run under qemu-user.
#
# apt works with lists and a status of its own, and packages are only unpacked: this system's packages and
# architectures stay as they are, and no root rights are needed. Nothing is done where DIR is already there.
# MIRROR and SUITE choose another Debian than the one in use here.
set -eu

arch=$1
dir=$2
packages="libc6-dev libgcc-s1 libturbojpeg0-dev libspng-dev libjansson-dev zlib1g-dev libcmocka-dev"

# The cache outlives the tree: another list of packages needs another root.
if [ -e "$dir" ] && [ "$(cat "$dir/packages" 2>/dev/null)" = "$packages" ]; then exit 0; fi

echo "making a root for $arch in $dir"
new=$dir.$$
trap 'rm -rf "$new"' EXIT
trap 'exit 1' INT TERM
apt=$new/apt
mkdir -p "$apt/lists/partial" "$apt/cache/archives/partial" "$new/usr"
: >"$apt/status"

if [ -z "${MIRROR:-}" ]; then
    # shellcheck disable=SC2016 # apt-get expands it
    MIRROR=$(apt-get indextargets --format '$(SITE)' 'Origin: Debian' 2>/dev/null | head -n 1)
    [ -n "$MIRROR" ] || MIRROR=http://deb.debian.org/debian
fi
echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $MIRROR ${SUITE:-bookworm} main" \
    >"$apt/sources.list"

private_apt() {
    apt-get -qq -o APT::Architecture="$arch" -o APT::Architectures::="$arch" -o APT::Install-Recommends=0 \
        -o APT::Sandbox::User=root -o Debug::NoLocking=1 -o Dir::Etc::sourcelist="$apt/sources.list" \
        -o Dir::Etc::sourceparts=/dev/null -o Dir::State::lists="$apt/lists" \
        -o Dir::State::status="$apt/status" -o Dir::Cache="$apt/cache" "$@"
}
private_apt update
# shellcheck disable=SC2086
private_apt -y --download-only install $packages

# As on an installed system, /lib is /usr/lib; dpkg -x would replace such links by folders.
for name in bin lib lib64 sbin; do
    mkdir "$new/usr/$name"
    ln -s "usr/$name" "$new/$name"
done
for package in "$apt"/cache/archives/*.deb; do
    dpkg-deb --fsys-tarfile "$package" | tar -x --keep-directory-symlink --no-same-owner -C "$new"
done
rm -rf "$apt"

# Absolute links would lead out of the root.
find "$new" -type l -lname '/*' | while read -r link; do
    target=$new$(readlink "$link")
    ln -sfn "$(realpath -m -s --relative-to="$(dirname "$link")" "$target")" "$link"
done

printf '%s\n' "$packages" >"$new/packages"
rm -rf "$dir"
mv -T "$new" "$dir"
