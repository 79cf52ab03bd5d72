# Makefile - builds, tests and installs splatfit.
#
# make               build/splatfit, build/libsplatfit.a and build/libsplatfit.so.1
# make demo          fits a simulated scene and shows what came out; installs what is missing
# make test          unit tests, golden cases, levels; installs what is missing
# make test-fresh    the README's two commands on fresh Debian systems; TESTS="bookworm/bare": only these. Needs root; half an hour and more
# make test-golden   the golden tests alone
# make check         the kernels at every level of this machine
# make test-vm       cameras of an emulated board: its kernel's drivers, ours, libcamera; minutes. LIBCAMERA=PREFIX: of an emulated
#                    machine of this one's kind, through the libcamera that is installed there
# make mutants       wrong edits of kernels, each of which a program of make check must notice
# make check-cpus    the kernels on emulated older processors, each at the level that it chooses
# make crash         fits killed at 200 moments; a disk that is full at each call, or one in EVERY=7; memory that ends; minutes
# make test-allocations  each job of the library without each of the blocks that it asks for; minutes
# make coverage      lines of src and arch that the tests run, at least 90 %: build/coverage/index.html; gcc alone, half an hour
# make test-scenes   whole fits, held to their quality; with SPLATFIT_DATA of real scenes too
# make stability     where methods of this kind fail, and what shows it: build/stability/index.html; minutes
# make bench         speed and accuracy on this machine: build/bench.json, build/bench-*.svg; minutes
# make bench-quick   whether the bench works: build/bench-quick.json; seconds
# make charts        quality against time and size of sets of fits: build/charts/index.html; SPLATFIT_DATA as above; some 45 minutes with PARTS=fits, else more
# make charts-quick  whether that works: build/charts-quick; seconds
# make test-outside  other tools' readers and writers of models on our files, and we on theirs; viewers of others draw them; npm fetches all
# make fuzz          hostile input for every parser, FUZZ_SECONDS (20) each: needs clang and libFuzzer
# make soak          30 minutes of capture at 30 frames a second; SECONDS=20 for less
# make endurance     10,000 cycles of all that is made and destroyed, then an hour's fit: memory does not grow; CYCLES=100 SECONDS=60 for less
# make lint          include order, headers and their comments, symbols, ABI, links, format, forbidden words, scripts, the mutants' texts
# make doc           all that the public headers declare as one page: build/doc/index.html
# make abi           writes tests/abi/abi.txt anew: what programs link against
# make ci            lint, and the tests by every compiler, sanitizer and emulated machine
# make deps          installs what build and tests need; make deps-ci: what ci needs
# make install       program, headers, libraries, splatfit.pc, manual, completion to $(DESTDIR)$(PREFIX); make uninstall
# make man           the pages of the manual: build/*/man
# make deb           Debian packages of this machine or of TOOLCHAIN: build/deb; make test-deb installs and runs them
# make sizes         bytes of program and library without debugging information, a row of toolchains/README.md
# make clean         removes build/
#
# CC=clang           another compiler            CFLAGS=, LDFLAGS=  appended to the flags
# TOOLCHAIN=NAME     one of toolchains/*.mk      SAN=LIST           sanitizers, e.g. address,undefined
# TESTS="ply pool"   only these tests            WERROR=1           warnings are errors
# PREFIX=/usr/local  where to install            V=1                shows the commands
# COVERAGE=1         a build that counts lines, for make coverage
# STATIC=1           a program that needs no shared library, tested by test-static

TOOLCHAIN ?= native
PREFIX    ?= /usr/local
LIBDIR    ?= $(PREFIX)/lib

# Of the library; of its interface, which goes up where a program built against the last one would break.
VERSION   := $(shell sed -n 's/^#define SF_VERSION *"\(.*\)"/\1/p' include/splatfit/context.h)
SOVERSION := $(shell sed -n 's/^#define SF_ABI *\([0-9]*\)$$/\1/p' include/splatfit/context.h)

# A toolchain sets CC, CXX, AR, NM, PKG_CONFIG, TARGET_CFLAGS, TARGET_LDFLAGS, RUN (what runs its programs here),
# DEPS_BUILD, DEPS_TEST and DEPS_OPTIONAL (sets of tests/deps/deps.sh), PREPARE (a command before the first build), QEMU_ROOT (where
# qemu finds its libraries).
DEPS_BUILD := build
DEPS_TEST  := test
DEPS_OPTIONAL := optional
CACHE      := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/splatfit
include toolchains/$(TOOLCHAIN).mk
NM         ?= nm
PKG_CONFIG ?= pkg-config
ifeq ($(origin CXX),default)
CXX := $(patsubst %gcc,%g++,$(patsubst %clang,%clang++,$(firstword $(CC))))
endif

# Who asks for a demo or a test gets what is missing installed; a plain build only says what is missing.
INSTALL_DEPS := $(filter deps demo test test-allocations test-golden test-scenes stability check check-cpus build-tests endurance coverage-run,$(MAKECMDGOALS))

# Left out, with what it is for, where it is missing; Debian has no static one.
OPTIONAL     := $(if $(filter 1,$(STATIC)),,apriltag libcamera libwebp libzip libzstd)

# ---- files -------------------------------------------------------------------------------------------------

comma  := ,
CONFIG := $(TOOLCHAIN)$(if $(filter-out %gcc,$(CC)),-$(notdir $(firstword $(CC))))
CONFIG := $(CONFIG)$(if $(SAN),-$(subst $(comma),-,$(SAN)))$(if $(filter 1,$(STATIC)),-static)$(if $(filter 1,$(COVERAGE)),-coverage)
O      := build/$(CONFIG)

# What is installed is found out first, and read from config.mk: FOUND (of OPTIONAL), CIVETWEB, LIBS_CFLAGS, LIBS_FOUND,
# TEST_LIBS, PARTS (modules with their versions). `make -n` only looks.
DEPS_NOW = $(DEPS_BUILD) $(if $(INSTALL_DEPS),$(DEPS_TEST)) $(if $(filter 1,$(STATIC)),source)
.DEFAULT_GOAL := all
ifneq ($(filter-out clean help doc uninstall ci fuzz mutants test-vm coverage test-fresh,$(or $(MAKECMDGOALS),all)),)
CONFIGURED := $(shell CC='$(CC)' CXX='$(CXX)' CFLAGS='$(CFLAGS)' PKG_CONFIG='$(PKG_CONFIG)' \
    LINK='$(TARGET_CFLAGS) $(CFLAGS) $(TARGET_LDFLAGS) $(LDFLAGS)' LOOK=$(if $(INSTALL_DEPS),$(findstring n,$(firstword -$(MAKEFLAGS))),1) \
    DEPS='$(DEPS_NOW)' DEPS_OPTIONAL='$(if $(OPTIONAL),$(DEPS_OPTIONAL))' PREPARE='$(PREPARE)' OPTIONAL='$(OPTIONAL)' STATIC='$(STATIC)' \
    tests/deps/config.sh $(O)/config.mk >&2 && echo yes)
ifneq ($(CONFIGURED),yes)
$(error stopped)
endif
include $(O)/config.mk
endif

HEADERS := $(wildcard include/splatfit/*.h)
MACHINE := $(firstword $(subst -, ,$(shell $(CC) $(TARGET_CFLAGS) -dumpmachine)))
FAMILY  := $(if $(filter x86_64 i%86,$(MACHINE)),x86,$(if $(filter aarch64% arm%,$(MACHINE)),arm))
LIB_SRC := $(filter-out src/app/% src/bench/% src/chart/% src/preview/%,$(wildcard src/*/*.c)) \
           $(wildcard arch/scalar/*.c $(FAMILY:%=arch/%/*.c))
APP_SRC := $(wildcard src/app/*.c)
BENCH_SRC := $(wildcard src/bench/*.c)
CHART_SRC := $(wildcard src/chart/*.c)
PREVIEW_SRC := $(wildcard src/preview/*.c)
CXX_SRC := $(if $(filter libcamera,$(FOUND)),src/capture/libcamera.cc)
REF_SRC := $(wildcard tests/reference/*.c tests/golden/golden.c)

tests_in   = $(wildcard $(if $(TESTS),$(TESTS:%=tests/$(1)/test_%.c),tests/$(1)/test_*.c))
UNIT_SRC  := $(call tests_in,unit)
GOLD_SRC  := $(call tests_in,golden)
CHECK_SRC := $(call tests_in,check)
STAB_SRC  := $(call tests_in,stability)
SCENE_SRC := $(call tests_in,scenes)
# The page in a real browser.
PAGE_SRC  := $(call tests_in,preview)
LONG_SRC  := $(call tests_in,endurance)
# The program from outside, by a script.
SCRIPTS   := $(wildcard $(if $(TESTS),$(foreach d,crash app,$(TESTS:%=tests/$(d)/%.sh)),tests/crash/*.sh $(filter-out %/tap.sh,$(wildcard tests/app/*.sh))))

# A file of arch/vector is compiled once a level, with that level's flags.
LEVELS_x86   := sse4 avx2 avx512
LEVELS_arm   := neon
FLAGS_sse4   := -msse4.1
FLAGS_avx2   := -mavx2 -mfma
FLAGS_avx512 := -mavx512f -mavx512bw -mavx512dq -mavx512vl -mfma -mprefer-vector-width=512
FLAGS_neon   := $(if $(filter arm%,$(MACHINE)),-mfpu=neon-vfpv4)
LEVELS       := $(LEVELS_$(FAMILY))
VECTOR_SRC   := $(if $(LEVELS),$(filter-out arch/vector/roof.c,$(wildcard arch/vector/*.c)))

# What splatfit bench measures and the library does not hold: the levels' roofs, and blending with other
# polynomials for exp2 and without the pairs.
VARIANTS   := exp2 exp3 exp4 exp5 exp6 cull
FLAGS_exp2 := -DSF_EXP_DEGREE=2
FLAGS_exp3 := -DSF_EXP_DEGREE=3
FLAGS_exp4 := -DSF_EXP_DEGREE=4
FLAGS_exp5 := -DSF_EXP_DEGREE=5
FLAGS_exp6 := -DSF_EXP_DEGREE=6
FLAGS_cull := -DSF_BLEND_CULL_ONLY=1

LIB_OBJ  := $(LIB_SRC:%.c=$(O)/%.o) $(CXX_SRC:%.cc=$(O)/%.o) $(foreach l,$(LEVELS),$(VECTOR_SRC:%.c=$(O)/%.$(l).o))
APP_OBJ  := $(APP_SRC:%.c=$(O)/%.o)
CHART_OBJ := $(CHART_SRC:%.c=$(O)/%.o)
PREVIEW_OBJ := $(PREVIEW_SRC:%.c=$(O)/%.o) $(if $(CIVETWEB),$(O)/src/preview/page_bytes.o)
BENCH_OBJ := $(BENCH_SRC:%.c=$(O)/%.o) $(CHART_OBJ) $(foreach l,$(LEVELS),$(O)/arch/vector/roof.$(l).o \
               $(VARIANTS:%=$(O)/arch/vector/blend.%.$(l).o))
REF_OBJ  := $(REF_SRC:%.c=$(O)/%.o)
# What starts the program.
PROGRAM_OBJ := $(O)/tests/program.o
TEST_OBJ := $(addprefix $(O)/tests/,testing.o blobs.o disturb.o)
# The targets of hostile input, and what of the program they call.
FUZZ_OBJ := $(patsubst %.c,$(O)/%.o,$(filter-out tests/fuzz/libfuzzer.c,$(wildcard tests/fuzz/*.c))) \
            $(filter-out $(O)/src/app/main.o,$(APP_OBJ)) $(BENCH_OBJ) $(PREVIEW_OBJ)
# What the programs of tests/check share.
CHECK_OBJ := $(O)/tests/check/check.o
# The experiments and their frame.
STAB_OBJ := $(patsubst %.c,$(O)/%.o,$(filter-out tests/stability/stability.c tests/stability/test_%,$(wildcard tests/stability/*.c)))

LIB     := $(O)/libsplatfit.a
SO      := $(if $(filter 1,$(STATIC)),,$(O)/libsplatfit.so.$(SOVERSION))
PROGRAM := $(O)/splatfit
UNIT    := $(UNIT_SRC:%.c=$(O)/%)
GOLD    := $(GOLD_SRC:%.c=$(O)/%)
CHECK   := $(CHECK_SRC:%.c=$(O)/%)
STAB    := $(STAB_SRC:%.c=$(O)/%)
STABILITY := $(O)/tests/stability/stability
SCENES  := $(SCENE_SRC:%.c=$(O)/%)
PAGES   := $(PAGE_SRC:%.c=$(O)/%)
LONG    := $(LONG_SRC:%.c=$(O)/%)
# A library that makes calls of a program fail; it goes before the program's own, where there are no sanitizers and no counts
# of lines to be written in the end.
SHIM    := $(if $(RUN)$(SAN)$(filter 1,$(STATIC))$(filter 1,$(COVERAGE)),,$(O)/tests/crash/shim.so)

# ---- flags -------------------------------------------------------------------------------------------------

WARNINGS := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition \
            -Wpointer-arith -Wwrite-strings -Wundef -Wvla
# Contraction would make arithmetic depend on the compiler.
BASE_CFLAGS  := -std=c11 -O2 -g $(WARNINGS) -ffp-contract=off -fno-math-errno \
                -fvisibility=hidden -fPIC -pthread -D_POSIX_C_SOURCE=200809L -D_FILE_OFFSET_BITS=64 \
                -Iinclude $(TARGET_CFLAGS)
BASE_LDFLAGS := -pthread $(TARGET_LDFLAGS)
ifeq ($(WERROR),1)
BASE_CFLAGS += -Werror
endif
ifneq ($(SAN),)
SANITIZE     := -fsanitize=$(SAN)$(if $(findstring undefined,$(SAN)),$(comma)float-cast-overflow) -fno-sanitize-recover=all
BASE_CFLAGS  += $(SANITIZE) -fno-omit-frame-pointer
BASE_LDFLAGS += $(SANITIZE)
endif

# Counts of lines that several threads count may miss some, but not all.
ifeq ($(COVERAGE),1)
BASE_CFLAGS  += --coverage -O1
BASE_LDFLAGS += --coverage
endif

MODULES      := libturbojpeg spng jansson zlib
MODULES      += $(FOUND)
BASE_CFLAGS  += $(if $(filter apriltag,$(FOUND)),-DSF_HAVE_APRILTAG) \
                $(if $(filter libcamera,$(FOUND)),-DSF_HAVE_LIBCAMERA) $(if $(filter libzip,$(FOUND)),-DSF_HAVE_LIBZIP) \
                $(if $(filter libzstd,$(FOUND)),-DSF_HAVE_ZSTD) $(if $(filter libwebp,$(FOUND)),-DSF_HAVE_LIBWEBP) \
                $(if $(CIVETWEB),-DSF_HAVE_CIVETWEB)
CXX_LIBS     := $(if $(filter libcamera,$(FOUND)),-lstdc++)
SPNG         :=
FETCH        :=
ifeq ($(STATIC),1)
BASE_LDFLAGS += -static
ifeq ($(WERROR),1)
BASE_LDFLAGS += -Wl,--fatal-warnings
endif
# Debian has no static libspng: where there is none, it is compiled from Debian's source.
ifeq ($(wildcard $(shell $(CC) $(BASE_LDFLAGS) -print-file-name=libspng.a)),)
SPNG         := $(O)/libspng.a
SPNG_SRC     := $(CACHE)/libspng
BASE_LDFLAGS += -L$(O)
FETCH        := tests/deps/libspng.sh $(SPNG_SRC)
endif
endif
LIBS        := $(LIBS_FOUND) $(CXX_LIBS) -lm

ALL_CFLAGS  = $(BASE_CFLAGS) $(LIBS_CFLAGS) $(CFLAGS)
# The C++ file has neither warnings in others' headers nor sanitizers, whose C++ parts a program linked as C lacks.
ALL_CXXFLAGS = -std=c++17 -Wno-psabi $(filter-out -std=c11 -Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition \
                 $(SANITIZE),$(BASE_CFLAGS)) $(LIBS_CFLAGS:-I%=-isystem%) $(CFLAGS)
ALL_LDFLAGS = $(BASE_LDFLAGS) $(LDFLAGS)

ifeq ($(V),1)
say := @:
else
Q   := @
say := @printf '%-5s %s\n'
endif

# ---- building ----------------------------------------------------------------------------------------------

.PHONY: all lib
all: lib $(PROGRAM)
lib: $(LIB) $(if $(SAN)$(filter 1,$(COVERAGE)),,$(SO))

# build/splatfit is the last native program made, and so are the libraries beside it.
ifeq ($(TOOLCHAIN)$(SAN)$(filter 1,$(STATIC))$(filter 1,$(COVERAGE)),native)
LATEST := build/splatfit build/libsplatfit.a build/libsplatfit.so.$(SOVERSION)
.PHONY: $(LATEST)
all: $(LATEST)
$(LATEST): build/%: $(O)/%
	@ln -sfn $(CONFIG)/$* $@
endif

# Each holds what it is named for; it changes only when that does, and then all that depends on it is remade.
$(O)/flags: TEXT = $(PARTS) $(CC) $(CXX) $(ALL_CFLAGS) $(ALL_LDFLAGS) $(LIBS) $(TEST_LIBS)
$(O)/sources: TEXT = $(LIB_OBJ) $(APP_SRC) $(BENCH_OBJ) $(PREVIEW_OBJ) $(REF_SRC)
$(O)/flags $(O)/sources: FORCE
	@mkdir -p $(@D)
	@printf '%s\n' '$(subst ','\'',$(TEXT))' | cmp -s - $@ || printf '%s\n' '$(subst ','\'',$(TEXT))' >$@
.PHONY: FORCE
FORCE:

$(O)/%.o: %.c $(O)/flags
	$(say) CC $<
	@mkdir -p $(@D)
	$(Q)$(CC) $(ALL_CFLAGS) $(if $(filter tests/%,$<),-Isrc -Itests) -MMD -MP -c -o $@ $<

$(O)/%.o: %.cc $(O)/flags
	$(say) CXX $<
	@mkdir -p $(@D)
	$(Q)$(CXX) $(ALL_CXXFLAGS) -MMD -MP -c -o $@ $<

# Given another KERNELS_O alone, nothing is built anew.
KERNELS_O := $(if $(SAN)$(filter 1,$(COVERAGE)),1,3)
define level_rule
$(O)/arch/vector/%.$(1).o: arch/vector/%.c $(O)/flags
	$(say) CC '$$< ($(1))'
	@mkdir -p $$(@D)
	$(Q)$(CC) $(ALL_CFLAGS) -O$(KERNELS_O) $(FLAGS_$(1)) -DSF_LEVEL=$(1) -DSF_LEVEL_$(1) -MMD -MP -c -o $$@ $$<
endef
$(foreach l,$(LEVELS),$(eval $(call level_rule,$(l))))

# Declared where they are called, in src/bench/levels.c. Sanitizers, which make the compiler slow, see the blending itself.
define variant_rule
$(O)/arch/vector/blend.$(2).$(1).o: arch/vector/blend.c $(O)/flags
	$(say) CC '$$< ($(1), $(2))'
	@mkdir -p $$(@D)
	$(Q)$(CC) $$(filter-out $$(SANITIZE),$$(ALL_CFLAGS)) -O$$(if $$(SAN),1,$(KERNELS_O)) $(FLAGS_$(1)) -DSF_LEVEL=$(1) -DSF_LEVEL_$(1) $(FLAGS_$(2)) \
	    -DSF_BLEND_VARIANT=$(2) -Wno-missing-prototypes -MMD -MP -c -o $$@ $$<
endef
$(foreach l,$(LEVELS),$(foreach v,$(VARIANTS),$(eval $(call variant_rule,$(l),$(v)))))

$(LIB): $(LIB_OBJ) $(O)/sources
	$(say) AR $@
	@rm -f $@
	$(Q)$(AR) rcs $@ $(LIB_OBJ)

$(O)/libsplatfit.so.$(SOVERSION): $(LIB_OBJ) $(O)/sources src/exports.map
	$(say) LD $@
	$(Q)$(CC) -shared -Wl,-soname,$(@F) -Wl,--no-undefined -Wl,--version-script=src/exports.map $(ALL_LDFLAGS) -o $@ $(LIB_OBJ) $(LIBS)

$(O)/libspng.a: $(O)/flags | fetch
	$(say) CC $(SPNG_SRC)/spng.c
	$(Q)$(CC) -O2 -g -fPIC -DSPNG_DISABLE_OPT $(TARGET_CFLAGS) $(LIBS_CFLAGS) $(CFLAGS) \
	    -c -o $(O)/spng.o $(SPNG_SRC)/spng.c
	@rm -f $@
	$(Q)$(AR) rcs $@ $(O)/spng.o

# The page and all that it names as one document, in an array.
PAGE := $(addprefix src/preview/,page.sh page.html page.css $(notdir $(wildcard src/preview/*.js)))
$(O)/src/preview/page_bytes.c: $(PAGE)
	$(say) PAGE $@
	@mkdir -p $(@D)
	$(Q)src/preview/page.sh src/preview/page.html >$@.new && mv $@.new $@
$(O)/src/preview/page_bytes.o: $(O)/src/preview/page_bytes.c $(O)/flags
	$(Q)$(CC) $(ALL_CFLAGS) -Isrc -c -o $@ $<

# The program says how it was linked, and with what.
$(O)/src/app/parts.o: BASE_CFLAGS += -DSF_PARTS='"$(PARTS)"'
$(O)/src/app/licences.o: BASE_CFLAGS += $(if $(filter 1,$(STATIC)),-DSF_STATIC=1)
$(PROGRAM): $(APP_OBJ) $(BENCH_OBJ) $(PREVIEW_OBJ) $(LIB) $(O)/sources $(SPNG)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $(APP_OBJ) $(BENCH_OBJ) $(PREVIEW_OBJ) $(LIB) $(CIVETWEB) $(LIBS)

# A line "/* link: FLAGS */" in a test's source adds FLAGS to that test's link.
$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY): $(REF_OBJ)
$(CHECK): $(CHECK_OBJ)
$(STAB) $(STABILITY): $(STAB_OBJ) $(CHART_OBJ)
$(addprefix $(O)/tests/unit/test_,archive cli commands outputs) $(PAGES): $(PROGRAM_OBJ)
$(O)/tests/unit/test_bench: $(BENCH_OBJ)
$(O)/tests/unit/test_chart: $(CHART_OBJ)
$(O)/tests/unit/test_hostile: $(FUZZ_OBJ)
$(O)/tests/unit/test_preview $(PAGES): $(PREVIEW_OBJ)
$(PAGES): $(O)/tests/preview/browser.o
$(addprefix $(O)/tests/unit/test_,hostile preview) $(PAGES): PREVIEW_LIBS = $(CIVETWEB)
$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY) $(SCENES) $(LONG) $(PAGES): $(O)/%: %.c $(O)/%.o $(TEST_OBJ) $(LIB)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) $$(sed -n 's|^/\* link: \(.*\) \*/$$|\1|p' $<) -o $@ \
	    $(filter %.o,$^) $(LIB) $(PREVIEW_LIBS) $(LIBS) $(TEST_LIBS)

TEST_PROGRAM_OBJ := $(patsubst %,%.o,$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY) $(SCENES) $(LONG) $(PAGES)) \
                    $(O)/tests/preview/browser.o
-include $(patsubst %.o,%.d,$(LIB_OBJ) $(APP_OBJ) $(BENCH_OBJ) $(PREVIEW_OBJ) $(REF_OBJ) $(TEST_OBJ) $(PROGRAM_OBJ) $(CHECK_OBJ) $(FUZZ_OBJ) $(STAB_OBJ) \
    $(TEST_PROGRAM_OBJ) $(BOARD_GUEST) $(BOARD_UVCSIM))

FEED := $(O)/tests/capture/feed
$(FEED): $(FEED).o
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $<

# Built with SAN=fuzzer-no-link,..., by clang.
FUZZER := $(O)/tests/fuzz/libfuzzer
$(FUZZER): $(FUZZER).o $(FUZZ_OBJ) $(LIB)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -fsanitize=fuzzer -o $@ $(filter %.o,$^) $(LIB) $(CIVETWEB) $(LIBS)

# ---- testing -----------------------------------------------------------------------------------------------

run_tests  = @RUN='$(RUN)' SPLATFIT_PROGRAM='$(PROGRAM)' SHIM='$(SHIM)' tests/run.sh
# With the figures that passed tests print; $(call show_tests,VARIABLES).
show_tests = @RUN='$(RUN)' SPLATFIT_PROGRAM='$(PROGRAM)' SHIM='$(SHIM)' SHOW=1 TIMEOUT=$${TIMEOUT:-1200} $(1) tests/run.sh

.PHONY: test crash test-allocations test-golden test-scenes stability test-vm fuzz fuzz-program soak endurance coverage coverage-run board-programs check check-cpus build-tests test-install test-outside test-static test-fresh lint abi doc ci demo bench bench-quick charts charts-quick
build-tests: $(UNIT) $(GOLD) $(CHECK) $(STAB) $(PAGES) $(PROGRAM) $(if $(SCRIPTS),$(SHIM))
test: build-tests
	$(run_tests) $(UNIT) $(GOLD) $(CHECK) $(STAB) $(PAGES) $(SCRIPTS)
$(O)/tests/crash/shim.so: tests/crash/shim.c $(O)/flags
	$(say) LD $@
	@mkdir -p $(@D)
	$(Q)$(CC) $(ALL_CFLAGS) -shared -o $@ $< -ldl
KILLS := 200
EVERY := 1
crash: $(PROGRAM) $(SHIM)
	$(call show_tests,KILLS=$(KILLS) EVERY=$(EVERY)) tests/crash/kill.sh tests/crash/disk.sh
# make test asks for fewer of the long jobs' blocks.
ALLOCATIONS := $(O)/tests/unit/test_allocations
test-allocations: $(ALLOCATIONS)
	$(call show_tests,SPLATFIT_FULL=1) $(ALLOCATIONS)
test-golden: $(GOLD)
	$(call show_tests) $(GOLD)
# The programs that hold kernels to float64, once a level; then what compares the levels.
LEVEL_TESTS := $(patsubst %,$(O)/tests/unit/test_%,bin render loss) $(O)/tests/golden/test_golden
# Where it is not emulated: so are the quick experiments.
CHECKED := $(LEVEL_TESTS) $(if $(RUN),,$(STAB))
check: $(CHECKED) $(CHECK) $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/check/levels.sh '$(CHECKED)' '$(CHECK)' scalar $(LEVELS)
# Emulated vectors are slow.
check-cpus: $(LEVEL_TESTS) $(PROGRAM)
	@OBJDUMP='$(NM:%nm=%objdump)' QEMU_ROOT='$(QEMU_ROOT)' PROGRAM='$(PROGRAM)' SPLATFIT_QUICK=1 TIMEOUT=$${TIMEOUT:-900} \
	    tests/check/cpus.sh $(MACHINE) '$(LEVEL_TESTS)' '$(LIB) $(APP_OBJ) $(BENCH_OBJ)'
# Each in a copy of the tree; some minutes.
mutants:
	@CC='$(CC)' MAKE='$(MAKE)' tests/mutants/run.sh
# What runs in the emulated board: without shared libraries, and with them where there is a libcamera for it.
BOARD_GUEST := $(addprefix $(O)/tests/capture/,guest.o guest_vivid.o guest_faults.o guest_uvc.o guest_libcamera.o \
                 guest_virtual.o guest_live.o vivid.o webcam.o pattern.o)
BOARD_UVCSIM := $(addprefix $(O)/tests/capture/,uvcsim.o uvc.o usb.o pattern.o)
$(O)/tests/capture/guest: $(BOARD_GUEST) $(LIB) $(SPNG)
$(O)/tests/capture/uvcsim: $(BOARD_UVCSIM) $(SPNG)
$(O)/tests/capture/guest $(O)/tests/capture/uvcsim:
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $(filter %.o %/libsplatfit.a,$^) $(LIBS)
board-programs: $(O)/tests/capture/guest $(O)/tests/capture/uvcsim $(PROGRAM)
BOARD := aarch64-linux-gnu
test-vm:
	@MAKE='$(MAKE)' ONLY='$(TESTS)' LIBCAMERA='$(LIBCAMERA)' tests/capture/board.sh $(CACHE) $(if $(LIBCAMERA),native,$(BOARD))
# Whole fits, held to their quality; minutes. SPLATFIT_DATA names the folder of real scenes.
test-scenes: $(SCENES) $(PROGRAM)
	$(call show_tests,SCENES=1) $(SCENES) $(filter %/memory.sh,$(SCRIPTS))

# Hostile input: each target for FUZZ_SECONDS; TESTS names some.
fuzz-program: $(FUZZER)
fuzz:
	@MAKE='$(MAKE)' TARGETS='$(TESTS)' tests/fuzz/fuzz.sh
# Where methods of this kind fail; minutes. STAB_FLAGS, e.g. --only 1,5; SPLATFIT_DATA as above.
stability: $(STABILITY) $(PROGRAM)
	@mkdir -p build/stability
	@RUN='$(RUN)' MAKE='$(MAKE)' CC='$(CC)' SPLATFIT_PROGRAM='$(PROGRAM)' $(RUN) $(STABILITY) --json build/stability/stability.json \
	    --html build/stability/index.html $(STAB_FLAGS)

# Every frame is accounted for, memory does not grow.
SECONDS := 1800
soak: $(PROGRAM) $(FEED)
	@RUN='$(RUN)' tests/capture/soak.sh '$(PROGRAM)' '$(FEED)' $(SECONDS)

# Built apart, as COVERAGE=1 has it.
coverage:
	$(if $(findstring clang,$(CC)),$(error make coverage: needs gcc, whose gcov reads the counts))
	@$(MAKE) --no-print-directory COVERAGE=1 coverage-run
coverage-run: build-tests
	@MAKE='$(MAKE)' GCOV='$(shell $(CC) -print-prog-name=gcov)' LEVELS='$(LEVELS)' PROGRAM='$(PROGRAM)' \
	    tests/coverage/coverage.sh build/coverage $(O)

# The hour is a fit's, of SPLATFIT_DATA's fox or the embedded scene.
CYCLES := 10000
endurance: SECONDS := 3600
endurance: $(LONG) $(PROGRAM)
	$(call show_tests,CYCLES=$(CYCLES) FIT_SECONDS=$(SECONDS) TIMEOUT=$$(($(SECONDS) + 3600))) $(LONG) tests/endurance/fit.sh

# SUITE/START of tests/fresh/fresh.sh.
test-fresh:
	@CACHE='$(CACHE)' tests/fresh/fresh.sh $(TESTS)
test-install: all
	@CC='$(CC)' MAKE='$(MAKE)' tests/install.sh
test-outside: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/outside/splat_transform.sh
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/outside/viewers.sh
test-static: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/check/static.sh

lint: $(LIB) $(SO)
	@CC='$(CC)' NM='$(NM)' CFLAGS='$(BASE_CFLAGS) $(LIBS_CFLAGS)' LIB=$(LIB) SO=$(SO) tests/lint/lint.sh

# The list of what others link against, rewritten: read include/splatfit/README.md before.
abi: $(SO)
	@CC='$(CC)' NM='$(NM)' tests/abi/list.py $(SO) >build/abi.txt && mv build/abi.txt tests/abi/abi.txt

# All that the headers declare, with the comments, as one page.
doc:
	@mkdir -p build/doc
	@tests/docs/declarations.py --html $(HEADERS) >build/doc/index.html.new && mv build/doc/index.html.new build/doc/index.html
	@echo build/doc/index.html

ci:
	@MAKE='$(MAKE)' tests/ci.sh

# Instructions are counted first, where valgrind is there, and go into the report. BENCH_FLAGS, e.g. --quick.
bench: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/callgrind.sh build/bench-instructions.txt $(LEVELS)
	$(RUN) $(PROGRAM) bench --json build/bench.json --svg build --instructions build/bench-instructions.txt \
	    $(BENCH_FLAGS)

bench-quick: $(PROGRAM)
	$(RUN) $(PROGRAM) bench --quick --json build/bench-quick.json >build/bench-quick.txt

charts: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/charts.sh build/charts
charts-quick: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/charts.sh build/charts-quick quick

demo: all
	$(PROGRAM) fit sim:studio --steps 1500 --max-gaussians 40000 -o build/demo.ply --compare build/demo.png \
	    $(DEMO_FLAGS)
	@echo 'build/demo.ply: the model, for any viewer of Gaussian splats'
	@echo 'build/demo.png: left a picture that the fit never saw, right the fit rendered from there'

# ---- what must be there first ------------------------------------------------------------------------------

.PHONY: fetch deps deps-ci
fetch:
	@$(FETCH)

# What is missing was installed before make got here.
deps: fetch

CI_TOOLCHAINS := aarch64-linux-gnu arm-linux-gnueabihf
deps-ci: deps
	@tests/deps/deps.sh ci vm browser arm64 armhf
	@set -e; for t in $(CI_TOOLCHAINS); do $(MAKE) --no-print-directory TOOLCHAIN=$$t deps; done
	@$(MAKE) --no-print-directory STATIC=1 deps

# ---- installing --------------------------------------------------------------------------------------------

define PC
prefix=$(PREFIX)
libdir=$(LIBDIR)
includedir=$${prefix}/include

Name: splatfit
Description: Fits 3D Gaussian scenes to pictures on CPUs
Version: $(VERSION)
Requires.private: $(MODULES)
Libs: -L$${libdir} -lsplatfit
Libs.private: $(CXX_LIBS) -lm -pthread
Cflags: -I$${includedir}
endef
export PC

# What the programs' tables say, and what src/app/man adds by hand.
MAN := $(patsubst src/app/man/%.man,$(O)/man/%.1,$(wildcard src/app/man/*.man))
.PHONY: install uninstall man deb test-deb sizes clean help
man: $(MAN)
$(O)/man/%.1: src/app/man/%.man src/app/man/page.sh $(PROGRAM)
	$(say) MAN $@
	@mkdir -p $(@D)
	$(Q)src/app/man/page.sh $* $(RUN) $(PROGRAM) >$@.new && mv $@.new $@

COMPLETIONS := $(PREFIX)/share/bash-completion/completions
install: all man
	$(Q)install -d "$(DESTDIR)$(PREFIX)/bin" "$(DESTDIR)$(PREFIX)/include/splatfit"
	$(Q)install -d "$(DESTDIR)$(LIBDIR)/pkgconfig"
	$(Q)install -m 755 $(PROGRAM) "$(DESTDIR)$(PREFIX)/bin"
	$(Q)install -m 644 $(HEADERS) "$(DESTDIR)$(PREFIX)/include/splatfit"
	$(Q)install -m 644 $(LIB) $(SO) "$(DESTDIR)$(LIBDIR)"
	$(if $(SO),$(Q)ln -sfn $(notdir $(SO)) "$(DESTDIR)$(LIBDIR)/libsplatfit.so")
	$(Q)printf '%s\n' "$$PC" >"$(DESTDIR)$(LIBDIR)/pkgconfig/splatfit.pc"
	$(Q)install -d "$(DESTDIR)$(PREFIX)/share/man/man1" "$(DESTDIR)$(COMPLETIONS)"
	$(Q)install -m 644 $(MAN) "$(DESTDIR)$(PREFIX)/share/man/man1"
	$(Q)install -m 644 src/app/man/completion.bash "$(DESTDIR)$(COMPLETIONS)/splatfit"

uninstall:
	$(Q)rm -f "$(DESTDIR)$(PREFIX)/bin/splatfit" "$(DESTDIR)$(COMPLETIONS)/splatfit" "$(DESTDIR)$(LIBDIR)"/libsplatfit.* \
	    "$(DESTDIR)$(LIBDIR)/pkgconfig/splatfit.pc" $(patsubst $(O)/man/%,"$(DESTDIR)$(PREFIX)/share/man/man1/%",$(MAN))
	$(Q)rm -rf "$(DESTDIR)$(PREFIX)/include/splatfit"

# Debian's packages of what this toolchain builds.
DEB_ARCH   = $(or $(DEBIAN_ARCH),$(shell dpkg --print-architecture))
DEB_TRIPLE = $(or $(TRIPLE),$(shell $(CC) -dumpmachine))
DEB_ENV    = MAKE='$(MAKE)' NM='$(NM)' RUN='$(RUN)' PROGRAM='$(PROGRAM)' VERSION='$(VERSION)' SOVERSION='$(SOVERSION)' TRIPLE='$(DEB_TRIPLE)'
deb: all man
	+@$(DEB_ENV) toolchains/deb/deb.sh $(DEB_ARCH) '$(SYSROOT)' build/deb
sizes: all
	@NM='$(NM)' toolchains/sizes.sh $(CONFIG) $(PROGRAM) $(SO)
test-deb: deb
	+@$(DEB_ENV) RUN_IN='$(if $(RUN),$(firstword $(RUN)) -L)' toolchains/deb/test.sh $(DEB_ARCH) '$(SYSROOT)' build/deb

clean:
	$(Q)rm -rf build

help:
	@sed -n '2,/^$$/s/^# \{0,1\}//p' Makefile
