# rpi5.mk - Raspberry Pi 5 with a 64-bit system: four Cortex-A76.
CPU_CFLAGS := -mcpu=cortex-a76
QEMU_CPU   := cortex-a76
include toolchains/aarch64-linux-gnu.mk
