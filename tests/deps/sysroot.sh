#!/bin/sh
# sysroot.sh ARCH DIR - makes in DIR a root of Debian's libraries for ARCH (amd64, arm64, armhf), to build
# against and to run under qemu-user.
#
# Packages are only unpacked: this system's packages and architectures stay as they are, and no root rights are needed.
# Nothing is done where DIR is already there. MIRROR and SUITE as in apt.sh.
set -eu

arch=$1
dir=$2
packages="libc6-dev libgcc-s1 libturbojpeg0-dev libspng-dev libjansson-dev zlib1g-dev libcmocka-dev libapriltag-dev"
packages="$packages libcamera-dev libwebp-dev libzip-dev libzstd-dev libcivetweb-dev libexif-dev"

# One at a time: make may ask for it more than once.
mkdir -p "$(dirname "$dir")"
exec 9>"$dir.lock"
flock 9

# The cache outlives the tree: another list of packages needs another root.
if [ -e "$dir" ] && [ "$(cat "$dir/packages" 2>/dev/null)" = "$packages" ]; then exit 0; fi

echo "making a root for $arch in $dir"
new=$dir.$$
trap 'rm -rf "$new"' EXIT
trap 'exit 1' INT TERM
apt=$new/apt
mkdir -p "$new/usr"
# shellcheck source=tests/deps/apt.sh
. "$(dirname "$0")/apt.sh"
begin_apt "$apt" deb "$arch"
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
