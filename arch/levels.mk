# levels.mk - the levels of this machine's family: each compiles every file of arch/vector once, with its own flags.

MACHINE := $(firstword $(subst -, ,$(shell $(CC) $(TARGET_CFLAGS) -dumpmachine)))
FAMILY  := $(if $(filter x86_64 i%86,$(MACHINE)),x86,$(if $(filter aarch64% arm%,$(MACHINE)),arm))

LEVELS_x86   := sse4 avx2 avx512
LEVELS_arm   := neon
FLAGS_sse4   := -msse4.1
FLAGS_avx2   := -mavx2 -mfma
FLAGS_avx512 := -mavx512f -mavx512bw -mavx512dq -mavx512vl -mfma -mprefer-vector-width=512
FLAGS_neon   := $(if $(filter arm%,$(MACHINE)),-mfpu=neon-vfpv4)
LEVELS       := $(LEVELS_$(FAMILY))
# What some processors of a level add, as LEVEL_ADDED: the file match.c is compiled for it once more.
ADDED        := $(if $(filter avx512,$(LEVELS)),avx512_vnni)$(if $(filter aarch64%,$(MACHINE)),neon_dot)
FLAGS_avx512_vnni := $(FLAGS_avx512) -mavx512vnni
FLAGS_neon_dot    := -march=armv8.2-a+dotprod
WITHOUT_neon_dot  := -mcpu=% -march=%

SCALAR_SRC := $(wildcard arch/scalar/*.c $(FAMILY:%=arch/%/*.c))
VECTOR_SRC := $(if $(LEVELS),$(filter-out arch/vector/roof.c,$(wildcard arch/vector/*.c)))
VECTOR_OBJ := $(foreach l,$(LEVELS),$(VECTOR_SRC:%.c=$(O)/%.$(l).o)) $(ADDED:%=$(O)/arch/vector/match.%.o)

# What splatfit bench measures and the library does not hold: the roofline of each level, and blending with polynomials for
# exp2 of other degrees and without the list of pairs.
VARIANTS   := exp2 exp3 exp4 exp5 exp6 cull
FLAGS_exp2 := -DSF_EXP_DEGREE=2
FLAGS_exp3 := -DSF_EXP_DEGREE=3
FLAGS_exp4 := -DSF_EXP_DEGREE=4
FLAGS_exp5 := -DSF_EXP_DEGREE=5
FLAGS_exp6 := -DSF_EXP_DEGREE=6
FLAGS_cull := -DSF_BLEND_CULL_ONLY=1
VARIANT_OBJ := $(foreach l,$(LEVELS),$(O)/arch/vector/roof.$(l).o $(VARIANTS:%=$(O)/arch/vector/blend.%.$(l).o))

# The levels whose kernels have the sanitizers, which make clang take several times as long.
SAN_LEVELS ?= $(LEVELS) $(ADDED)
# Given another KERNELS_O alone, nothing is built anew.
KERNELS_O := $(if $(filter 1,$(DEBUG)),0,$(if $(SAN)$(filter 1,$(COVERAGE)),1,3))
define level_rule
$(O)/arch/vector/%.$(1).o: arch/vector/%.c $(O)/flags
	$(say) CC '$$< ($(1))'
	@mkdir -p $$(@D)
	$(Q)$(CC) $$(filter-out $(WITHOUT_$(1)) $(if $(filter $(1),$(SAN_LEVELS)),,$$(SANITIZE)),$$(ALL_CFLAGS)) -O$(KERNELS_O) $(FLAGS_$(1)) \
	    -DSF_LEVEL=$(1) -DSF_LEVEL_$(firstword $(subst _, ,$(1))) -MMD -MP -c -o $$@ $$<
endef
$(foreach l,$(LEVELS) $(ADDED),$(eval $(call level_rule,$(l))))

# Declared where they are called, in src/bench/levels.c. They have no sanitizers, which make the compiler slow: the blending that
# the library holds has them.
define variant_rule
$(O)/arch/vector/blend.$(2).$(1).o: arch/vector/blend.c $(O)/flags
	$(say) CC '$$< ($(1), $(2))'
	@mkdir -p $$(@D)
	$(Q)$(CC) $$(filter-out $$(SANITIZE),$$(ALL_CFLAGS)) -O$$(if $$(SAN),1,$(KERNELS_O)) $(FLAGS_$(1)) \
	    -DSF_LEVEL=$(1) -DSF_LEVEL_$(1) $(FLAGS_$(2)) \
	    -DSF_BLEND_VARIANT=$(2) -Wno-missing-prototypes -MMD -MP -c -o $$@ $$<
endef
$(foreach l,$(LEVELS),$(foreach v,$(VARIANTS),$(eval $(call variant_rule,$(l),$(v)))))
