#!/bin/bash
# board.sh CACHE TOOLCHAIN - boots an emulated arm64 board and runs the tests of guest.c in it: twice, with the simulated
# cameras alone, and with libcamera between them and us. With LIBCAMERA it boots a machine of this one's kind, once: its
# root is this system's, its libcamera the one below that prefix.
#
# CACHE       where prepare.sh and tests/deps/sysroot.sh put what outlives the tree
# TOOLCHAIN   that of the board; native with LIBCAMERA
# LIBCAMERA   a prefix, such as /usr/local; none where empty
# MAKE, ONLY  make; only tests whose name holds this
# SPLATFIT_QUICK  not empty: without the tests that take minutes
# Ends with a line of sums as tests/run.sh does.
set -uo pipefail

here=$(dirname "$0")
toolchain=$2 arch=arm64 root=$1/sysroot-arm64 strip=aarch64-linux-gnu-strip libraries=''
if [ -n "${LIBCAMERA:-}" ]; then arch=$(dpkg --print-architecture) root=/ strip=strip; fi
cache=$1/vm-$arch
case $arch in
amd64) machine=(qemu-system-x86_64 -M q35 -cpu max) console=ttyS0 ;;
*) machine=(qemu-system-aarch64 -M virt -cpu cortex-a72) console=ttyAMA0 ;;
esac
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM

skip() {
    echo "the emulated board is skipped: $1"
    echo "0 passed, 0 failed, 1 skipped"
    exit 0
}

for program in "${machine[0]}" cpio /sbin/modprobe $strip; do
    command -v "$program" >/dev/null || skip "$(basename "$program") is not installed (make deps-ci)"
done
"$here/prepare.sh" "$cache" "$arch" >"$scratch/prepare" 2>&1 || {
    cat "$scratch/prepare"
    skip "its kernel cannot be had"
}

echo "building for the emulated board"
build() { # WHAT...
    "${MAKE:-make}" --no-print-directory TOOLCHAIN="$toolchain" TESTS= "$@" board-programs >"$scratch/build" 2>&1 && return
    cat "$scratch/build"
    echo "0 passed, 1 failed, 0 skipped"
    exit 1
}

# The programs, in a second archive that the kernel unpacks over the first.
pack() { # FOLDER OUT
    local files=$scratch/files program
    rm -rf "$files"
    mkdir -p "$files/bin"
    install -m 755 "$here/init.sh" "$files/init"
    for program in tests/capture/guest tests/capture/uvcsim splatfit; do
        $strip -o "$files/bin/$(basename $program)" "$1/$program" || return
    done
    (cd "$files" && find . | cpio -o -H newc -R 0:0 --quiet) | gzip -1 | cat "$cache/initramfs" - >"$2"
}

: >"$scratch/sums"
boards=0
boot() { # NAME GROUPS SECONDS FOLDER QEMU-OPTION...
    local name=$1 groups=$2 limit=$3 began=$SECONDS status
    boards=$((boards + 1))
    pack "$4" "$scratch/initrd" || return
    shift 4
    timeout --foreground -k 5 "$limit" "${machine[@]}" -accel tcg -m 512 -nodefaults \
        -no-user-config -display none -monitor none -serial stdio -no-reboot -kernel "$cache/vmlinuz" \
        -initrd "$scratch/initrd" -append "console=$console quiet panic=-1 tests=$groups ${ONLY:+only=$ONLY} ${SPLATFIT_QUICK:+quick=1} $libraries" "$@" \
        </dev/null >"$scratch/serial" 2>&1
    status=$?
    tr -d '\r' <"$scratch/serial" >"$scratch/out"
    awk -v name="board: $name" -v status=$status -v seconds=$((SECONDS - began)) -v limit="$limit" \
        -v none="${ONLY:+1}" -v show="${SHOW:-0}" -v sums="$scratch/sums" -f "$here/../tap.awk" "$scratch/out"
}

boot_shared() { # NAME GROUPS SECONDS FOLDER
    boot "$@" -smp 2 -fsdev "local,security_model=none,readonly=on,id=root,path=$root" \
        -device virtio-9p-pci,fsdev=root,mount_tag=root
}

boot_board() {
    build STATIC=1 deps
    build STATIC=0 deps
    boot "vivid, uvcvideo" vivid,faults,uvc 300 "build/$toolchain-static"
    if grep -q SF_HAVE_LIBCAMERA "build/$toolchain/flags"; then
        boot_shared "libcamera, live" libcamera,live 1200 "build/$toolchain"
    else
        echo "board: libcamera: skipped: $root has none"
        echo 0 0 1 >>"$scratch/sums"
        boards=$((boards + 1))
    fi
}

# A separate folder, for another libcamera than the tree is built with.
boot_libcamera() {
    local folder file
    for file in "$LIBCAMERA"/lib/pkgconfig/libcamera.pc "$LIBCAMERA"/lib/*/pkgconfig/libcamera.pc; do
        [ -e "$file" ] && folder=$(dirname "$(dirname "$file")")
    done
    [ -n "${folder:-}" ] || skip "there is no libcamera.pc below $LIBCAMERA/lib"
    export PKG_CONFIG_PATH=$folder/pkgconfig
    libraries="prefix=$LIBCAMERA libraries=$folder"
    build STATIC=0 O=build/libcamera LDFLAGS="-Wl,-rpath-link,$folder"
    boot_shared "libcamera $(pkg-config --modversion libcamera)" libcamera,virtual 500 build/libcamera
}

if [ -n "${LIBCAMERA:-}" ]; then boot_libcamera; else boot_board; fi
awk -v expected=$boards -f "$here/../sums.awk" "$scratch/sums"
