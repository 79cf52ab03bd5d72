# debian.mk - what the cross toolchains share: Debian's cross compiler and a private root of its libraries.
#
# Takes TRIPLE, DEBIAN_ARCH, QEMU_ARCH, QEMU_CPU and CPU_CFLAGS from the toolchain that includes it.

SYSROOT ?= $(CACHE)/sysroot-$(DEBIAN_ARCH)

ifeq ($(origin CC),default)
CC = $(TRIPLE)-gcc
endif
ifeq ($(origin AR),default)
AR = $(TRIPLE)-ar
endif
NM := $(TRIPLE)-nm

TARGET_CFLAGS  := $(CPU_CFLAGS) --sysroot=$(SYSROOT)
TARGET_LDFLAGS := --sysroot=$(SYSROOT)

# What lies in the root's own folders needs no -I and -L.
PKG_CONFIG := PKG_CONFIG_SYSROOT_DIR=$(SYSROOT) \
              PKG_CONFIG_LIBDIR=$(SYSROOT)/usr/lib/$(TRIPLE)/pkgconfig:$(SYSROOT)/usr/share/pkgconfig \
              PKG_CONFIG_SYSTEM_INCLUDE_PATH=$(SYSROOT)/usr/include \
              PKG_CONFIG_SYSTEM_LIBRARY_PATH=$(SYSROOT)/usr/lib/$(TRIPLE) pkg-config

# A static program is to find nothing of the root.
QEMU_ROOT := $(if $(filter 1,$(STATIC)),,-L $(SYSROOT))
# The least CPU that the flags allow: an instruction beyond them fails here, too.
RUN := qemu-$(QEMU_ARCH)-static -cpu $(QEMU_CPU) $(QEMU_ROOT)

DEPS_BUILD := $(DEBIAN_ARCH)
DEPS_TEST  :=
DEPS_OPTIONAL :=
PREPARE    := tests/deps/sysroot.sh $(DEBIAN_ARCH) $(SYSROOT)
