# arm-linux-gnueabihf.mk - 32-bit ARM with NEON and VFPv4, from the Cortex-A7 on (Raspberry Pi 2 and later).
TRIPLE      := arm-linux-gnueabihf
DEBIAN_ARCH := armhf
CPU_CFLAGS  := -march=armv7-a -mfpu=neon-vfpv4 -mfloat-abi=hard
QEMU_ARCH   := arm
QEMU_CPU    := cortex-a7
include toolchains/debian.mk
