# install.mk - what is installed, and where.

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

.PHONY: install uninstall
COMPLETIONS := $(PREFIX)/share/bash-completion/completions
install: all man
	$(Q)install -d "$(DESTDIR)$(PREFIX)/bin" "$(DESTDIR)$(PREFIX)/include/splatfit"
	$(Q)install -d "$(DESTDIR)$(LIBDIR)/pkgconfig"
	$(Q)install -m 755 $(PROGRAM) $(MPI_PROGRAMS) "$(DESTDIR)$(PREFIX)/bin"
	$(Q)install -m 644 $(HEADERS) "$(DESTDIR)$(PREFIX)/include/splatfit"
	$(Q)install -m 644 $(LIB) $(SO) "$(DESTDIR)$(LIBDIR)"
	$(if $(SO),$(Q)ln -sfn $(notdir $(SO)) "$(DESTDIR)$(LIBDIR)/libsplatfit.so")
	$(Q)printf '%s\n' "$$PC" >"$(DESTDIR)$(LIBDIR)/pkgconfig/splatfit.pc"
	$(Q)install -d "$(DESTDIR)$(PREFIX)/share/man/man1" "$(DESTDIR)$(COMPLETIONS)"
	$(Q)install -m 644 $(MAN) "$(DESTDIR)$(PREFIX)/share/man/man1"
	$(Q)install -m 644 src/app/man/completion.bash "$(DESTDIR)$(COMPLETIONS)/splatfit"

uninstall:
	$(Q)rm -f "$(DESTDIR)$(PREFIX)/bin/splatfit" $(MPI:%="$(DESTDIR)$(PREFIX)/bin/splatfit-%") \
	    "$(DESTDIR)$(COMPLETIONS)/splatfit" "$(DESTDIR)$(LIBDIR)"/libsplatfit.* \
	    "$(DESTDIR)$(LIBDIR)/pkgconfig/splatfit.pc" $(patsubst $(O)/man/%,"$(DESTDIR)$(PREFIX)/share/man/man1/%",$(MAN))
	$(Q)rm -rf "$(DESTDIR)$(PREFIX)/include/splatfit"
