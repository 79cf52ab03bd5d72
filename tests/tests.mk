# tests.mk - the commands that test, lint and measure. Makefile says what each is for.

run_tests  = @RUN='$(RUN)' SPLATFIT_PROGRAM='$(PROGRAM)' SHIM='$(SHIM)' tests/run.sh
# With the figures that passed tests print; $(call show_tests,VARIABLES).
show_tests = @RUN='$(RUN)' SPLATFIT_PROGRAM='$(PROGRAM)' SHIM='$(SHIM)' SHOW=1 TIMEOUT=$${TIMEOUT:-1200} $(1) tests/run.sh

.PHONY: build-tests test test-golden test-allocations test-scenes crash
build-tests: $(UNIT) $(GOLD) $(CHECK) $(STAB) $(PAGES) $(PROGRAM) $(if $(SCRIPTS),$(SHIM))
test: build-tests
	$(run_tests) $(UNIT) $(GOLD) $(CHECK) $(STAB) $(PAGES) $(SCRIPTS)
test-golden: $(GOLD)
	$(call show_tests) $(GOLD)
# All parts of tests of tests/unit, as TESTS finds them.
parts_of    = $(patsubst %.c,$(O)/%,$(sort $(foreach t,$(1),$(wildcard tests/unit/test_$(t).c tests/unit/test_$(t)_*.c))))
# make test asks for fewer of the long jobs' blocks.
ALLOCATIONS := $(call parts_of,allocations)
test-allocations: $(ALLOCATIONS)
	$(call show_tests,SPLATFIT_FULL=1) $(ALLOCATIONS)
# SPLATFIT_DATA names the folder of real scenes.
test-scenes: $(SCENES) $(PROGRAM)
	$(call show_tests,SCENES=1) $(SCENES) $(filter %/memory.sh,$(SCRIPTS))
KILLS := 200
EVERY := 1
crash: $(PROGRAM) $(SHIM)
	$(call show_tests,KILLS=$(KILLS) EVERY=$(EVERY)) tests/crash/kill.sh tests/crash/disk.sh

# ---- kernels -----------------------------------------------------------------------------------------------

.PHONY: check check-cpus mutants
# The programs that hold kernels to float64, once a level; then what compares the levels.
LEVEL_TESTS := $(call parts_of,bin render loss) $(O)/tests/golden/test_golden
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

# ---- cameras, hostile input, long runs, coverage -----------------------------------------------------------

.PHONY: board-programs test-vm fuzz-program fuzz soak endurance coverage coverage-run
board-programs: $(O)/tests/capture/guest $(O)/tests/capture/uvcsim $(PROGRAM)
BOARD := aarch64-linux-gnu
test-vm:
	@MAKE='$(MAKE)' ONLY='$(TESTS)' LIBCAMERA='$(LIBCAMERA)' tests/capture/board.sh $(CACHE) $(if $(LIBCAMERA),native,$(BOARD))

# Each target for FUZZ_SECONDS; TESTS names some.
fuzz-program: $(FUZZER)
fuzz:
	@MAKE='$(MAKE)' TARGETS='$(TESTS)' tests/fuzz/fuzz.sh

# Every frame is accounted for, memory does not grow.
SECONDS := 1800
soak: $(PROGRAM) $(FEED)
	@RUN='$(RUN)' tests/capture/soak.sh '$(PROGRAM)' '$(FEED)' $(SECONDS)

# The hour is a fit's, of SPLATFIT_DATA's fox or the embedded scene.
CYCLES := 10000
endurance: SECONDS := 3600
endurance: $(LONG) $(PROGRAM)
	$(call show_tests,CYCLES=$(CYCLES) FIT_SECONDS=$(SECONDS) TIMEOUT=$$(($(SECONDS) + 3600))) $(LONG) tests/endurance/fit.sh

# Built apart, as COVERAGE=1 has it.
coverage:
	$(if $(findstring clang,$(CC)),$(error make coverage: needs gcc, whose gcov reads the counts))
	@$(MAKE) --no-print-directory COVERAGE=1 coverage-run
coverage-run: build-tests
	@MAKE='$(MAKE)' GCOV='$(shell $(CC) -print-prog-name=gcov)' LEVELS='$(LEVELS)' PROGRAM='$(PROGRAM)' \
	    tests/coverage/coverage.sh build/coverage $(O)

# ---- from outside ------------------------------------------------------------------------------------------

.PHONY: ci test-fresh test-install test-outside test-static
ci:
	@MAKE='$(MAKE)' tests/ci.sh
# TESTS names systems, SUITE/START, as tests/fresh/fresh.sh has them.
test-fresh:
	@CACHE='$(CACHE)' tests/fresh/fresh.sh $(TESTS)
test-install: all
	@CC='$(CC)' MAKE='$(MAKE)' tests/install.sh
test-outside: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/outside/splat_transform.sh
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/outside/viewers.sh
test-static: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/check/static.sh

# ---- the source --------------------------------------------------------------------------------------------

.PHONY: lint lint-quick abi doc compile_commands.json objects
lint: $(LIB) $(SO)
	@CC='$(CC)' NM='$(NM)' CFLAGS='$(BASE_CFLAGS) $(LIBS_CFLAGS)' LIB=$(LIB) SO=$(SO) tests/lint/lint.sh
lint-quick:
	@QUICK=1 tests/lint/lint.sh
# Read include/splatfit/README.md before.
abi: $(SO)
	@CC='$(CC)' NM='$(NM)' tests/abi/list.py $(SO) >build/abi.txt && mv build/abi.txt tests/abi/abi.txt
doc:
	@mkdir -p build/doc
	@tests/docs/declarations.py --html $(HEADERS) >build/doc/index.html.new && mv build/doc/index.html.new build/doc/index.html
	@echo build/doc/index.html
objects: $(ALL_OBJ)
compile_commands.json:
	@$(MAKE) --no-print-directory -nB V=1 objects | awk -v folder='$(CURDIR)' -f tests/docs/compile_commands.awk \
	    >build/$@.new && mv build/$@.new build/$@
	@echo build/$@

# ---- measurements ------------------------------------------------------------------------------------------

.PHONY: bench bench-arm bench-quick charts charts-quick stability demo
# PARTS, AGAINST and BENCH_FLAGS: as tests/bench/bench.sh says; SPLATFIT_DATA as above.
bench: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' LEVELS='$(LEVELS)' BENCH_FLAGS='$(BENCH_FLAGS)' PARTS='$(PARTS)' AGAINST='$(AGAINST)' \
	    tests/bench/bench.sh
bench-quick: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/bench.sh quick
# llvm-mca's estimates; deps-bench installs what it needs.
bench-arm:
	@mkdir -p build
	@tests/bench/arm.py >build/bench-arm.md && cat build/bench-arm.md
charts: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/charts.sh build/charts
charts-quick: $(PROGRAM)
	@RUN='$(RUN)' PROGRAM='$(PROGRAM)' tests/bench/charts.sh build/charts-quick quick
# STAB_FLAGS, e.g. --only 1,5; SPLATFIT_DATA as above.
stability: $(STABILITY) $(PROGRAM)
	@mkdir -p build/stability
	@RUN='$(RUN)' MAKE='$(MAKE)' CC='$(CC)' SPLATFIT_PROGRAM='$(PROGRAM)' $(RUN) $(STABILITY) --json build/stability/stability.json \
	    --html build/stability/index.html $(STAB_FLAGS)
demo: all
	$(PROGRAM) fit sim:studio --steps 1500 --max-gaussians 40000 -o build/demo.ply --compare build/demo.png \
	    $(DEMO_FLAGS)
	@echo 'build/demo.ply: the model, for any viewer of Gaussian splats'
	@echo 'build/demo.png: left a picture that the fit never saw, right the fit rendered from there'
