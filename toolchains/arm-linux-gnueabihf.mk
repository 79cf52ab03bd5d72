# arm-linux-gnueabihf.mk - 32-bit ARM as Debian's armhf has it: ARMv7-A with VFPv3-D16 (Raspberry Pi 2 and later with a
# 32-bit system). Only the neon level of arch/vector is compiled for NEON with VFPv4, from the Cortex-A7 on.
TRIPLE      := arm-linux-gnueabihf
DEBIAN_ARCH := armhf
CPU_CFLAGS  := -march=armv7-a+fp -mfloat-abi=hard
QEMU_ARCH   := arm
QEMU_CPU    := cortex-a7
include toolchains/debian.mk
