# rpi4.mk - Raspberry Pi 4 with a 64-bit system: four Cortex-A72.
CPU_CFLAGS := -mcpu=cortex-a72
QEMU_CPU   := cortex-a72
include toolchains/aarch64-linux-gnu.mk
