# Makefile - builds, tests and installs splatfit.
#
# make               build/splatfit, build/libsplatfit.a and build/libsplatfit.so.1
# make demo          fits a simulated scene and shows what came out; installs what is missing
# make install       program, headers, libraries, splatfit.pc, manual, completion to $(DESTDIR)$(PREFIX); make uninstall
# make man           the pages of the manual: build/*/man
# make deb           Debian packages of this machine or of TOOLCHAIN: build/deb; make test-deb installs and runs them
# make sizes         bytes of program and library without debugging information, a row of toolchains/README.md
# make deps          installs what build and tests need; make deps-ci: what ci needs
# make clean         removes build/
#
# make test          unit tests, golden cases, levels; installs what is missing
# make test-golden   the golden tests alone
# make test-scenes   whole fits, held to their quality; with SPLATFIT_DATA of real scenes too
# make test-allocations  each job of the library without each of the blocks that it asks for; minutes
# make check         the kernels at every level of this machine
# make check-cpus    the kernels on emulated older processors, each at the level that it chooses
# make mutants       wrong edits of kernels, each of which a program of make check must notice
# make crash         fits killed at 200 moments; a disk that is full at each call, or one in EVERY=7; memory that ends; minutes
# make fuzz          hostile input for every parser, FUZZ_SECONDS (20) each: needs clang and libFuzzer
# make test-mpi      fits on several ranks by mpirun; MPI="openmpi mpich" names the MPIs
# make soak          30 minutes of capture at 30 frames a second; SECONDS=20 for less
# make endurance     10,000 cycles of all that is made and destroyed, then an hour's fit: memory does not grow;
#                    CYCLES=100 SECONDS=60 for less
# make coverage      lines of src and arch that the tests run, at least 90 %: build/coverage/index.html; gcc alone, half an hour
# make test-vm       cameras of an emulated board: its kernel's drivers, ours, libcamera; minutes.
#                    LIBCAMERA=PREFIX: of an emulated machine of this one's kind, through the libcamera that is installed there
# make test-outside  other tools' readers and writers of models on our files, and we on theirs; viewers of others draw them;
#                    npm fetches all
# make test-fresh    the README's two commands on fresh Debian systems; TESTS="bookworm/bare": only these.
#                    Needs root; half an hour and more
# make lint          include order, lengths, headers and their comments, symbols, ABI, links, format, forbidden words, scripts,
#                    makefiles, the mutants' texts
# make lint-quick    what of it takes seconds, and of C files and scripts those alone that differ from the last commit
# make ci            lint, and the tests by every compiler, sanitizer and emulated machine
#
# make bench         speed and accuracy on this machine: build/bench.json, build/bench-*.svg, build/bench-sfm.txt; minutes.
#                    PARTS=against AGAINST=PROGRAM: fits beside another build's program: build/bench-against.md
# make bench-arm     what llvm-mca says of the hot loops on ARM: build/bench-arm.md; make deps-bench installs what it needs
# make bench-quick   whether the bench works: build/bench-quick.json; seconds
# make charts        quality against time and size of sets of fits: build/charts/index.html; SPLATFIT_DATA as above;
#                    some 45 minutes with PARTS=fits, else more
# make charts-quick  whether that works: build/charts-quick; seconds
# make stability     where methods of this kind fail, and what shows it: build/stability/index.html; minutes
#
# make doc           all that the public headers declare as one page: build/doc/index.html
# make compile_commands.json  build/compile_commands.json: how each file is compiled, for clangd and other tools
# make abi           writes tests/abi/abi.txt anew: what programs link against
#
# CC=clang           another compiler            CFLAGS=, LDFLAGS=  appended to the flags
# TOOLCHAIN=NAME     one of toolchains/*.mk      SAN=LIST           sanitizers, e.g. address,undefined
# TESTS="ply pool"   only these tests            BUT="cli photos"   all tests but these
# WERROR=1           warnings are errors
# PREFIX=/usr/local  where to install            V=1                shows the commands
# COVERAGE=1         a build that counts lines, for make coverage
# MPI=openmpi        also build/*/splatfit-openmpi, whose fits run on several machines; or mpich, or both
# DEBUG=1            a build for a debugger, -O0 -g3: build/native-debug/splatfit
# STATIC=1           a program that needs no shared library, tested by test-static

TOOLCHAIN ?= native
PREFIX    ?= /usr/local
LIBDIR    ?= $(PREFIX)/lib

# Of the library; of its interface, which goes up where a program built against the last one would break.
VERSION   := $(shell sed -n 's/^#define SF_VERSION *"\(.*\)"/\1/p' include/splatfit/context.h)
SOVERSION := $(shell sed -n 's/^#define SF_ABI *\([0-9]*\)$$/\1/p' include/splatfit/context.h)

# A toolchain sets CC, CXX, AR, NM, PKG_CONFIG, TARGET_CFLAGS, TARGET_LDFLAGS, RUN (what runs its programs here),
# DEPS_BUILD, DEPS_TEST and DEPS_OPTIONAL (sets of tests/deps/deps.sh), PREPARE (a command before the first build),
# QEMU_ROOT (where qemu finds its libraries).
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

# All that is made lies in build/; what depends on toolchain, compiler and options in a folder that is named for them.
comma  := ,
CONFIG := $(TOOLCHAIN)$(if $(filter-out %gcc,$(CC)),-$(notdir $(firstword $(CC))))
CONFIG := $(CONFIG)$(if $(SAN),-$(subst $(comma),-,$(SAN)))$(if $(filter 1,$(STATIC)),-static)
CONFIG := $(CONFIG)$(if $(filter 1,$(COVERAGE)),-coverage)$(if $(filter 1,$(DEBUG)),-debug)
O      := build/$(CONFIG)

.DEFAULT_GOAL := all
# In this order: each uses what those before it set.
include tests/deps/deps.mk
include toolchains/rules/flags.mk
include toolchains/rules/compile.mk
include arch/levels.mk
include src/sources.mk
include src/cluster/mpi.mk
include tests/programs.mk
include tests/tests.mk
include toolchains/rules/install.mk
include toolchains/deb/deb.mk

.PHONY: all lib clean help
all: lib $(PROGRAM)
lib: $(LIB) $(if $(SAN)$(filter 1,$(COVERAGE)),,$(SO))

# build/splatfit is the last native program made for use, and so are the libraries beside it.
ifeq ($(TOOLCHAIN)$(SAN)$(filter 1,$(STATIC) $(COVERAGE) $(DEBUG)),native)
LATEST := build/splatfit build/libsplatfit.a build/libsplatfit.so.$(SOVERSION)
.PHONY: $(LATEST)
all: $(LATEST)
$(LATEST): build/%: $(O)/%
	@ln -sfn $(CONFIG)/$* $@
endif

clean:
	$(Q)rm -rf build

help:
	@sed -n '2,/^$$/s/^# \{0,1\}//p' Makefile
