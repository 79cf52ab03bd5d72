# mpi.mk - MPI="openmpi mpich": for each, the program whose fits run on several machines, beside the one without MPI.
#
# They differ in the file that sees MPI, in the one that calls it, and in what `info --build` says.

MPI_KINDS   := openmpi mpich
MPI_WRONG   := $(filter-out $(MPI_KINDS),$(MPI))
$(if $(MPI_WRONG),$(error MPI=$(MPI): one or both of $(MPI_KINDS)))
# The module of pkg-config.
mpi_module   = $(patsubst openmpi,ompi-c,$(1))
MPI_SRC     := src/cluster/mpi.c src/cluster/join.c src/app/parts.c
MPI_PROGRAMS := $(MPI:%=$(O)/splatfit-%)

define mpi_rules
MPI_VERSION_$(1) := $$(shell $$(PKG_CONFIG) --modversion $$(call mpi_module,$(1)) 2>/dev/null)
$$(if $$(MPI_VERSION_$(1)),,$$(error MPI=$(1): pkg-config knows no $$(call mpi_module,$(1)): install lib$(1)-dev))
MPI_CFLAGS_$(1)  := $$(shell $$(PKG_CONFIG) --cflags $$(call mpi_module,$(1))) -DSF_HAVE_MPI
MPI_LIBS_$(1)    := $$(shell $$(PKG_CONFIG) --libs $$(call mpi_module,$(1)))
$$(O)/$(1)/%.o: %.c $$(O)/flags
	$$(say) CC $$<
	@mkdir -p $$(@D)
	$$(Q)$$(CC) $$(ALL_CFLAGS) $$(MPI_CFLAGS_$(1)) -DSF_PARTS='"$$(PARTS) $$(call mpi_module,$(1))=$$(MPI_VERSION_$(1))"' \
	    -MMD -MP -c -o $$@ $$<
$$(O)/splatfit-$(1): $$(MPI_SRC:%.c=$$(O)/$(1)/%.o) $$(PROGRAM_PARTS) $$(LIB) $$(O)/sources
	$$(say) LD $$@
	$$(Q)$$(CC) $$(ALL_LDFLAGS) -o $$@ $$(MPI_SRC:%.c=$$(O)/$(1)/%.o) $$(filter-out $$(O)/src/app/parts.o,$$(PROGRAM_PARTS)) \
	    $$(LIB) $$(CIVETWEB) $$(LIBS) $$(MPI_LIBS_$(1))
endef
$(foreach kind,$(MPI),$(eval $(call mpi_rules,$(kind))))

MPI_PAGES := $(MPI:%=$(O)/man/splatfit-%.1)
MAN += $(MPI_PAGES)
man: $(MPI_PAGES)
$(MPI_PAGES): $(O)/man/splatfit-%.1: src/app/man/mpi.sh src/app/man/mpi.in include/splatfit/context.h
	$(say) MAN $@
	@mkdir -p $(@D)
	$(Q)src/app/man/mpi.sh $* $(VERSION) >$@.new && mv $@.new $@

.PHONY: mpi test-mpi
mpi: $(MPI_PROGRAMS)
ifneq ($(MPI),)
all: mpi
endif
# Open MPI keeps what it made until the process ends. MPICH's only leaks are those of hwloc's plugins, which it can do without.
test-mpi: mpi
	@set -e; for kind in $(MPI); do \
	    if [ $$kind = openmpi ]; then export ASAN_OPTIONS=detect_leaks=0; else export HWLOC_PLUGINS_PATH=/none; unset ASAN_OPTIONS; fi; \
	    RUN='$(RUN)' SPLATFIT_PROGRAM=$(O)/splatfit-$$kind tests/run.sh tests/app/mpi.sh; done
