# compile.mk - how a file is compiled, and what makes it be compiled again.

ifeq ($(V),1)
say := @:
else
Q   := @
say := @printf '%-5s %s\n'
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
	$(Q)$(CC) $(ALL_CFLAGS) $(UNIT_O) $(if $(filter tests/%,$<),-Isrc -Itests) -MMD -MP -c -o $@ $<

$(O)/%.o: %.cc $(O)/flags
	$(say) CXX $<
	@mkdir -p $(@D)
	$(Q)$(CXX) $(ALL_CXXFLAGS) -MMD -MP -c -o $@ $<

# Of Debian's source, for a static program (flags.mk).
$(O)/libspng.a: $(O)/flags | fetch
	$(say) CC $(SPNG_SRC)/spng.c
	$(Q)$(CC) -O2 -g -fPIC -DSPNG_DISABLE_OPT $(TARGET_CFLAGS) $(LIBS_CFLAGS) $(CFLAGS) \
	    -c -o $(O)/spng.o $(SPNG_SRC)/spng.c
	@rm -f $@
	$(Q)$(AR) rcs $@ $(O)/spng.o
