# sources.mk - the files of the library and of the program, and what is made of them.

HEADERS     := $(wildcard include/splatfit/*.h)
LIB_SRC     := $(filter-out src/app/% src/bench/% src/chart/% src/preview/%,$(wildcard src/*/*.c)) $(SCALAR_SRC)
CXX_SRC     := $(if $(filter libcamera,$(FOUND)),src/capture/libcamera.cc)
APP_SRC     := $(wildcard src/app/*.c)
BENCH_SRC   := $(wildcard src/bench/*.c)
CHART_SRC   := $(wildcard src/chart/*.c)
PREVIEW_SRC := $(wildcard src/preview/*.c)

LIB_OBJ     := $(LIB_SRC:%.c=$(O)/%.o) $(CXX_SRC:%.cc=$(O)/%.o) $(VECTOR_OBJ)
APP_OBJ     := $(APP_SRC:%.c=$(O)/%.o)
CHART_OBJ   := $(CHART_SRC:%.c=$(O)/%.o)
PREVIEW_OBJ := $(PREVIEW_SRC:%.c=$(O)/%.o) $(if $(CIVETWEB),$(O)/src/preview/page_bytes.o)
BENCH_OBJ   := $(BENCH_SRC:%.c=$(O)/%.o) $(CHART_OBJ) $(VARIANT_OBJ)

LIB         := $(O)/libsplatfit.a
SO          := $(if $(filter 1,$(STATIC)),,$(O)/libsplatfit.so.$(SOVERSION))
PROGRAM     := $(O)/splatfit
# What the program holds beside the library.
PROGRAM_PARTS := $(APP_OBJ) $(BENCH_OBJ) $(PREVIEW_OBJ)

$(LIB): $(LIB_OBJ) $(O)/sources
	$(say) AR $@
	@rm -f $@
	$(Q)$(AR) rcs $@ $(LIB_OBJ)

$(O)/libsplatfit.so.$(SOVERSION): $(LIB_OBJ) $(O)/sources src/exports.map
	$(say) LD $@
	$(Q)$(CC) -shared -Wl,-soname,$(@F) -Wl,--no-undefined -Wl,--version-script=src/exports.map $(ALL_LDFLAGS) -o $@ $(LIB_OBJ) $(LIBS)

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
$(PROGRAM): $(PROGRAM_PARTS) $(LIB) $(O)/sources $(SPNG)
	$(say) LD $@
	$(Q)$(CC) $(ALL_LDFLAGS) -o $@ $(PROGRAM_PARTS) $(LIB) $(CIVETWEB) $(LIBS)

# The pages of the manual: what the program says of its options, and what src/app/man adds by hand.
MAN := $(patsubst src/app/man/%.man,$(O)/man/%.1,$(wildcard src/app/man/*.man))
.PHONY: man
man: $(MAN)
$(O)/man/%.1: src/app/man/%.man src/app/man/page.sh $(PROGRAM)
	$(say) MAN $@
	@mkdir -p $(@D)
	$(Q)src/app/man/page.sh $* $(RUN) $(PROGRAM) >$@.new && mv $@.new $@
