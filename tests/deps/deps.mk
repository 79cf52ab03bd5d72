# deps.mk - finds the libraries of this machine before make reads its rules, and installs what is missing.

# Whoever asks for a demo or a test gets what is missing installed; a plain build only says what is missing.
INSTALLS     := deps demo test test-allocations test-golden test-scenes stability check check-cpus build-tests endurance coverage-run
INSTALL_DEPS := $(filter $(INSTALLS),$(MAKECMDGOALS))
DEPS_NOW      = $(DEPS_BUILD) $(if $(INSTALL_DEPS),$(DEPS_TEST)) $(if $(filter 1,$(STATIC)),source)

# Modules of pkg-config that are left out where they are missing; config.sh says what each is for. Of the others Debian has no static ones.
OPTIONAL := libexif $(if $(filter 1,$(STATIC)),,apriltag libcamera libwebp libzip libzstd)
WANTED_NOW := $(if $(DEPS_OPTIONAL),$(if $(filter 1,$(STATIC)),static,$(DEPS_OPTIONAL)))

# config.sh writes config.mk, which is read below: FOUND (of OPTIONAL), CIVETWEB, LIBS_CFLAGS, LIBS_FOUND, TEST_LIBS,
# PARTS (modules with their versions). `make -n` only looks.
NOT_CONFIGURED := bench-arm deps-bench clean help doc uninstall ci fuzz mutants test-vm coverage test-fresh lint-quick
ifneq ($(filter-out $(NOT_CONFIGURED),$(or $(MAKECMDGOALS),all)),)
CONFIGURED := $(shell CC='$(CC)' CXX='$(CXX)' CFLAGS='$(CFLAGS)' PKG_CONFIG='$(PKG_CONFIG)' \
    LINK='$(TARGET_CFLAGS) $(CFLAGS) $(TARGET_LDFLAGS) $(LDFLAGS)' LOOK=$(if $(INSTALL_DEPS),$(findstring n,$(firstword -$(MAKEFLAGS))),1) \
    DEPS='$(DEPS_NOW)' DEPS_OPTIONAL='$(WANTED_NOW)' PREPARE='$(PREPARE)' OPTIONAL='$(OPTIONAL)' STATIC='$(STATIC)' \
    tests/deps/config.sh $(O)/config.mk >&2 && echo yes)
ifneq ($(CONFIGURED),yes)
$(error stopped)
endif
include $(O)/config.mk
endif

# FETCH, set by toolchains/rules/flags.mk, brings sources that no package has.
.PHONY: fetch deps deps-bench deps-ci
fetch:
	@$(FETCH)

# What is missing was installed before make got here.
deps: fetch

CI_TOOLCHAINS := aarch64-linux-gnu arm-linux-gnueabihf
deps-bench:
	@tests/deps/deps.sh bench

deps-ci: deps
	@tests/deps/deps.sh ci vm browser arm64 armhf
	@set -e; for t in $(CI_TOOLCHAINS); do $(MAKE) --no-print-directory TOOLCHAIN=$$t deps; done
	@$(MAKE) --no-print-directory STATIC=1 deps
