# x86_64-linux-gnu.mk - any 64-bit x86; on such a machine with its own compiler and libraries.
CPU_CFLAGS := -march=x86-64 -mtune=generic
ifeq ($(shell uname -m),x86_64)
TARGET_CFLAGS := $(CPU_CFLAGS)
include toolchains/native.mk
else
TRIPLE      := x86_64-linux-gnu
DEBIAN_ARCH := amd64
QEMU_ARCH   := x86_64
QEMU_CPU    := qemu64
include toolchains/debian.mk
endif
