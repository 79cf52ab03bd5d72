#!/bin/sh
# init.sh - the first process of the emulated board: loads the simulated cameras, runs the tests that the kernel's
# command line names (tests=vivid,uvc; only=PART of a test's name; prefix= and libraries= of a libcamera), and switches the board off.
export PATH=/bin
/bin/busybox --install -s /bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
echo 1 >/proc/sys/kernel/printk # nothing but a panic among the results

# Two pairs of a capture and an output node, the second pair with several planes; a webcam and an HDMI input.
vivid="n_devs=2 node_types=0x101,0x101 multiplanar=1,2 num_inputs=2,2 input_types=0x0c,0x0c num_outputs=1,1
    output_types=1,1"

# A root of Debian's libraries for programs that are not static: everything is mounted or made beside it.
make_root() {
    for module in virtio_pci 9pnet_virtio 9p; do modprobe $module; done
    mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=262144,cache=loose root /mnt || return
    mount -t tmpfs root /tmp
    mkdir -p /tmp/usr /tmp/dev /tmp/proc /tmp/sys /tmp/bin /tmp/tmp /tmp/run/udev/data
    for name in lib lib64 sbin; do ln -s usr/$name /tmp/$name; done
    for name in usr dev proc; do
        case $name in usr) mount --bind /mnt/usr /tmp/usr ;; *) mount --bind /$name /tmp/$name ;; esac
    done
    cp /bin/busybox /bin/guest /bin/uvcsim /bin/splatfit /tmp/bin
    busybox --install -s /tmp/bin
    # What of libcamera is not below /usr, and where it looks for virtual cameras, which a test describes there.
    if [ -n "${prefix:-}" ] && [ ! -d "/tmp$prefix" ]; then
        mkdir -p "/tmp$prefix"
        mount --bind "/mnt$prefix" "/tmp$prefix"
    fi
    virtual=/tmp${prefix:-/usr}/share/libcamera/pipeline/virtual
    if [ -d "$virtual" ]; then mount -t tmpfs virtual "$virtual"; fi
    # libcamera names a webcam by the firmware's node of a device above it: the virtual controller has none, so one
    # is made up at the top of its /sys.
    mount -t tmpfs sys /tmp/sys
    for folder in /sys/*; do
        mkdir "/tmp$folder"
        mount --bind "$folder" "/tmp$folder"
    done
    mkdir /tmp/sys/firmware_node
    echo '\_SB_.TEST' >/tmp/sys/firmware_node/path
}

run_guest() { # GROUPS
    # shellcheck disable=SC2086 # one word a parameter
    modprobe vivid $vivid
    # shellcheck disable=SC2046 # one word a group
    set -- $(echo "$1" | tr , ' ')
    case $1 in
    libcamera) make_root && LD_LIBRARY_PATH=${libraries:-} chroot /tmp /bin/guest "$@" ;;
    *) /bin/guest "$@" ;;
    esac
}

modprobe vhci-hcd
modprobe uvcvideo
run_guest "${tests:-vivid}"
poweroff -f
