#!/bin/sh
# prepare.sh DIR ARCH - makes in DIR what the emulated board boots: Debian's kernel for ARCH (arm64, amd64), and an
# initramfs with busybox and the modules of the simulated cameras.
#
# Packages are only unpacked, as in tests/deps/sysroot.sh; MIRROR and SUITE as there. Nothing is done where DIR is
# already there.
set -eu

dir=$1 arch=$2
packages="linux-image-$arch busybox-static"
modules="vivid uvcvideo vhci-hcd virtio_pci 9pnet_virtio 9p"
made_of="$packages, $modules"

# The cache outlives the tree: other packages make another board.
if [ "$(cat "$dir/made-of" 2>/dev/null)" = "$made_of" ]; then exit 0; fi

echo "preparing the emulated board in $dir"
new=$dir.$$
trap 'rm -rf "$new"' EXIT
trap 'exit 1' INT TERM
mkdir -p "$new/debs" "$new/unpacked" "$new/root/bin"
here=$(realpath "$(dirname "$0")")
new=$(realpath "$new")
# shellcheck source=tests/deps/apt.sh
. "$here/../deps/apt.sh"
begin_apt "$new/apt" deb "$arch"

# The first package names the newest kernel.
kernel=$(private_apt -s install "linux-image-$arch" | awk '$1 == "Inst" && $2 ~ /^linux-image-[0-9]/ { print $2; exit }')
(cd "$new/debs" && private_apt download "$kernel" busybox-static)
for package in "$new"/debs/*.deb; do
    dpkg-deb --fsys-tarfile "$package" | tar -x --no-same-owner -C "$new/unpacked"
done

# Debian 13 has moved the modules, and compresses them.
[ -e "$new/unpacked/lib" ] || ln -s usr/lib "$new/unpacked/lib"
version=${kernel#linux-image-}
/sbin/depmod -b "$new/unpacked" "$version"
for module in $modules; do
    /sbin/modprobe -d "$new/unpacked" -S "$version" --show-depends "$module"
done | awk '$1 == "insmod" { print $2 }' | sort -u | while read -r file; do
    to=$new/root/${file#"$new/unpacked/"}
    mkdir -p "$(dirname "$to")"
    cp "$file" "$to"
    case $to in *.xz) xz -d "$to" ;; esac
done
cp "$new"/unpacked/lib/modules/"$version"/modules.builtin* "$new"/unpacked/lib/modules/"$version"/modules.order \
    "$new/root/lib/modules/$version"
/sbin/depmod -b "$new/root" "$version"
cp "$(find "$new/unpacked" -path "*bin/busybox")" "$new/root/bin/busybox"
ln -s busybox "$new/root/bin/sh"
(cd "$new/root" && mkdir dev proc sys tmp run mnt && find . | cpio -o -H newc -R 0:0 --quiet | gzip) \
    >"$new/initramfs"

mkdir "$new/done"
cp "$new/unpacked/boot/vmlinuz-$version" "$new/done/vmlinuz"
mv "$new/initramfs" "$new/done"
printf '%s\n' "$made_of" >"$new/done/made-of"
rm -rf "$dir"
mv -T "$new/done" "$dir"
