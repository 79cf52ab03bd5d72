# flags.mk - the flags of the compiler and of the linker, from the toolchain, the options of make and the libraries found.

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

ifeq ($(DEBUG),1)
BASE_CFLAGS  += -O0 -g3
endif

MODULES      := libturbojpeg spng jansson zlib $(FOUND)
BASE_CFLAGS  += $(if $(filter apriltag,$(FOUND)),-DSF_HAVE_APRILTAG) \
                $(if $(filter libcamera,$(FOUND)),-DSF_HAVE_LIBCAMERA) $(if $(filter libzip,$(FOUND)),-DSF_HAVE_LIBZIP) \
                $(if $(filter libzstd,$(FOUND)),-DSF_HAVE_ZSTD) $(if $(filter libwebp,$(FOUND)),-DSF_HAVE_LIBWEBP) \
                $(if $(filter libexif,$(FOUND)),-DSF_HAVE_LIBEXIF) $(if $(CIVETWEB),-DSF_HAVE_CIVETWEB)
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

