# deb.mk - Debian packages of what this toolchain builds, and their sizes.

DEB_ARCH   = $(or $(DEBIAN_ARCH),$(shell dpkg --print-architecture))
DEB_TRIPLE = $(or $(TRIPLE),$(shell $(CC) -dumpmachine))
DEB_ENV    = MAKE='$(MAKE)' NM='$(NM)' RUN='$(RUN)' PROGRAM='$(PROGRAM)' VERSION='$(VERSION)' SOVERSION='$(SOVERSION)' \
             TRIPLE='$(DEB_TRIPLE)' MPI='$(MPI)'
.PHONY: deb test-deb sizes
deb: all man
	+@$(DEB_ENV) toolchains/deb/deb.sh $(DEB_ARCH) '$(SYSROOT)' build/deb
test-deb: deb
	+@$(DEB_ENV) RUN_IN='$(if $(RUN),$(firstword $(RUN)) -L)' toolchains/deb/test.sh $(DEB_ARCH) '$(SYSROOT)' build/deb
sizes: all
	@NM='$(NM)' toolchains/sizes.sh $(CONFIG) $(PROGRAM) $(SO)
