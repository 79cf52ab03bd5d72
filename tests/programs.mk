# programs.mk - the programs of the tests: their files, and what each is linked with. TESTS names some; all are made without it,
# but those that BUT names.

# A name stands for all programs that begin with it: "ply" for test_ply.c and test_ply_values.c.
named     = $(foreach t,$(2),tests/$(1)/test_$(t).c tests/$(1)/test_$(t)_*.c)
tests_in  = $(sort $(filter-out $(wildcard $(call named,$(1),$(BUT))),\
                $(wildcard $(if $(TESTS),$(call named,$(1),$(TESTS)),tests/$(1)/test_*.c))))
UNIT_SRC  := $(call tests_in,unit)
GOLD_SRC  := $(call tests_in,golden)
CHECK_SRC := $(call tests_in,check)
STAB_SRC  := $(call tests_in,stability)
SCENE_SRC := $(call tests_in,scenes)
# The page in a real browser.
PAGE_SRC  := $(call tests_in,preview)
LONG_SRC  := $(call tests_in,endurance)
# The program from outside, by a script.
SCRIPTS   := $(wildcard $(if $(TESTS),$(foreach d,crash app,$(TESTS:%=tests/$(d)/%.sh)),\
                 tests/crash/*.sh $(filter-out %/tap.sh,$(wildcard tests/app/*.sh))))
REF_SRC   := $(wildcard tests/reference/*.c tests/golden/golden.c)

UNIT      := $(UNIT_SRC:%.c=$(O)/%)
GOLD      := $(GOLD_SRC:%.c=$(O)/%)
CHECK     := $(CHECK_SRC:%.c=$(O)/%)
STAB      := $(STAB_SRC:%.c=$(O)/%)
STABILITY := $(O)/tests/stability/stability
SCENES    := $(SCENE_SRC:%.c=$(O)/%)
PAGES     := $(PAGE_SRC:%.c=$(O)/%)
LONG      := $(LONG_SRC:%.c=$(O)/%)

TEST_OBJ  := $(addprefix $(O)/tests/,testing.o blobs.o disturb.o)
REF_OBJ   := $(REF_SRC:%.c=$(O)/%.o)
# What several programs of tests/unit share: a library, so that each takes only what it calls.
FIXTURES  := $(O)/tests/unit/fixtures.a
FIXTURE_OBJ := $(patsubst %.c,$(O)/%.o,$(wildcard tests/unit/*_fixture.c))
$(FIXTURES): $(FIXTURE_OBJ)
	@mkdir -p $(@D)
	$(Q)rm -f $@ && $(AR) rcs $@ $^
# With sanitizers the compiler takes a third of the time for these where it does not optimize, and they compute little themselves.
$(UNIT:%=%.o) $(FIXTURE_OBJ): UNIT_O := $(if $(SAN),-O0)
# What starts the program.
PROGRAM_OBJ := $(O)/tests/program.o
# What the programs of tests/check share.
CHECK_OBJ := $(O)/tests/check/check.o
# The experiments and their frame.
STAB_OBJ  := $(patsubst %.c,$(O)/%.o,$(filter-out tests/stability/stability.c tests/stability/test_%,$(wildcard tests/stability/*.c)))
# The targets of hostile input, and what of the program they call.
FUZZ_OBJ  := $(patsubst %.c,$(O)/%.o,$(filter-out tests/fuzz/libfuzzer.c,$(wildcard tests/fuzz/*.c))) \
             $(filter-out $(O)/src/app/main.o,$(PROGRAM_PARTS))

# A line "/* link: FLAGS */" in a test's source adds FLAGS to that test's link, TEST_LDFLAGS to all of them: another linker.
$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY): $(REF_OBJ)
$(UNIT): $(FIXTURES)
$(CHECK): $(CHECK_OBJ)
$(STAB) $(STABILITY): $(STAB_OBJ) $(CHART_OBJ)
$(filter $(addprefix $(O)/tests/unit/test_,archive photos% cli% commands outputs%),$(UNIT)) $(PAGES): $(PROGRAM_OBJ)
$(filter $(O)/tests/unit/test_bench%,$(UNIT)): $(BENCH_OBJ)
$(filter $(O)/tests/unit/test_chart%,$(UNIT)): $(CHART_OBJ)
$(filter $(O)/tests/unit/test_hostile%,$(UNIT)): $(FUZZ_OBJ)
$(filter $(O)/tests/unit/test_preview%,$(UNIT)) $(PAGES): $(PREVIEW_OBJ)
$(PAGES): $(O)/tests/preview/browser.o
$(filter $(addprefix $(O)/tests/unit/test_,hostile% preview%),$(UNIT)) $(PAGES): PREVIEW_LIBS = $(CIVETWEB)
$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY) $(SCENES) $(LONG) $(PAGES): $(O)/%: %.c $(O)/%.o $(TEST_OBJ) $(LIB)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) $(TEST_LDFLAGS) $$(sed -n 's|^/\* link: \(.*\) \*/$$|\1|p' $<) -o $@ \
	    $(filter %.o,$^) $(filter %/fixtures.a,$^) $(LIB) $(PREVIEW_LIBS) $(LIBS) $(TEST_LIBS)

# A library that makes calls of a program fail; it goes before the program's own, where there are no sanitizers and no counts
# of lines to be written in the end.
SHIM := $(if $(RUN)$(SAN)$(filter 1,$(STATIC))$(filter 1,$(COVERAGE)),,$(O)/tests/crash/shim.so)
$(O)/tests/crash/shim.so: tests/crash/shim.c $(O)/flags
	$(say) LD $@
	@mkdir -p $(@D)
	$(Q)$(CC) $(ALL_CFLAGS) -shared -o $@ $< -ldl

# Writes frames into a pipe at a camera's pace.
FEED := $(O)/tests/capture/feed
$(FEED): $(FEED).o
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $<

# Built with SAN=fuzzer-no-link,..., by clang.
FUZZER := $(O)/tests/fuzz/libfuzzer
$(FUZZER): $(FUZZER).o $(FUZZ_OBJ) $(LIB)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -fsanitize=fuzzer -o $@ $(filter %.o,$^) $(LIB) $(CIVETWEB) $(LIBS)

# What runs in the emulated board: without shared libraries, and with them where there is a libcamera for it.
BOARD_GUEST  := $(addprefix $(O)/tests/capture/,guest.o guest_vivid.o guest_faults.o guest_uvc.o guest_libcamera.o \
                  guest_virtual.o guest_live.o vivid.o webcam.o pattern.o)
BOARD_UVCSIM := $(addprefix $(O)/tests/capture/,uvcsim.o uvc.o usb.o pattern.o)
$(O)/tests/capture/guest: $(BOARD_GUEST) $(LIB) $(SPNG)
$(O)/tests/capture/uvcsim: $(BOARD_UVCSIM) $(SPNG)
$(O)/tests/capture/guest $(O)/tests/capture/uvcsim:
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $(filter %.o %/libsplatfit.a,$^) $(LIBS)

TEST_PROGRAM_OBJ := $(patsubst %,%.o,$(UNIT) $(GOLD) $(CHECK) $(STAB) $(STABILITY) $(SCENES) $(LONG) $(PAGES) $(FEED) $(FUZZER)) \
                    $(O)/tests/preview/browser.o
ALL_OBJ := $(sort $(LIB_OBJ) $(PROGRAM_PARTS) $(REF_OBJ) $(TEST_OBJ) $(PROGRAM_OBJ) $(CHECK_OBJ) $(FUZZ_OBJ) $(STAB_OBJ) $(FIXTURE_OBJ) \
             $(BOARD_GUEST) $(BOARD_UVCSIM) $(TEST_PROGRAM_OBJ))
-include $(ALL_OBJ:.o=.d)
