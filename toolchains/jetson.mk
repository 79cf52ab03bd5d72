# jetson.mk - NVIDIA Jetson Orin (Nano, NX, AGX): Cortex-A78AE. The first Nano, TX1 and TX2 have the Cortex-A57, which
# has the instructions of the Cortex-A72: rpi4.mk is for them.
#
# JetPack's C library is older than Debian 12's: STATIC=1 makes a program that does not ask for it.
CPU_CFLAGS := -mcpu=cortex-a78ae
# qemu 7.2 has no Cortex-A78AE. The A76 has all that the flags allow but SSBS, which no compiler uses by itself.
QEMU_CPU   := cortex-a76
include toolchains/aarch64-linux-gnu.mk
