# rpi-zero2.mk - Raspberry Pi Zero 2 W, and Pi 3, with a 64-bit system: four Cortex-A53.
CPU_CFLAGS := -mcpu=cortex-a53
QEMU_CPU   := cortex-a53
include toolchains/aarch64-linux-gnu.mk
