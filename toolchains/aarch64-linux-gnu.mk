# aarch64-linux-gnu.mk - 64-bit ARM, from the Cortex-A53 on (Raspberry Pi 3 and later with a 64-bit system).
#
# The boards' own files beside it say which CPU, and share all else.
TRIPLE      := aarch64-linux-gnu
DEBIAN_ARCH := arm64
CPU_CFLAGS  ?= -march=armv8-a
QEMU_ARCH   := aarch64
QEMU_CPU    ?= cortex-a53
include toolchains/debian.mk
