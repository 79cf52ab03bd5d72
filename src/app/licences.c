/* licences.c - what is linked into this program, under which terms, and where these are said. */
#include <stdio.h>

#include "app.h"

typedef struct licence {
    const char *name, *terms, *what, *where;
} licence;

static const licence linked[] = {
    {"libjpeg-turbo", "BSD-3-Clause and IJG", "JPEG pictures",
     "https://github.com/libjpeg-turbo/libjpeg-turbo/blob/main/LICENSE.md"},
    {"libspng", "BSD-2-Clause", "PNG pictures", "https://github.com/randy408/libspng/blob/master/LICENSE"},
    {"zlib", "Zlib", "compression", "https://zlib.net/zlib_license.html"},
    {"jansson", "MIT", "JSON", "https://github.com/akheron/jansson/blob/master/LICENSE"},
#ifdef SF_HAVE_LIBEXIF
    {"libexif", "LGPL-2.1-or-later", "the focal length that photos tell",
     "https://github.com/libexif/libexif/blob/master/COPYING"},
#endif
#ifdef SF_HAVE_LIBWEBP
    {"libwebp", "BSD-3-Clause", "pictures of SOG models",
     "https://chromium.googlesource.com/webm/libwebp/+/refs/heads/main/COPYING"},
#endif
#ifdef SF_HAVE_LIBZIP
    {"libzip", "BSD-3-Clause", "projects in a .zip", "https://libzip.org/license/"},
#endif
#ifdef SF_HAVE_ZSTD
    {"libzstd", "BSD-3-Clause", "compression of .spz, version 4",
     "https://github.com/facebook/zstd/blob/dev/LICENSE"},
#endif
#ifdef SF_HAVE_APRILTAG
    {"apriltag", "BSD-2-Clause", "boards",
     "https://github.com/AprilRobotics/apriltag/blob/master/LICENSE.md"},
#endif
#ifdef SF_HAVE_LIBCAMERA
    {"libcamera", "LGPL-2.1-or-later", "cameras of boards",
     "https://git.libcamera.org/libcamera/libcamera.git/tree/LICENSES"},
    {"libstdc++", "GPL-3.0-or-later with GCC-exception-3.1", "what libcamera's interface needs",
     "https://gcc.gnu.org/onlinedocs/libstdc++/manual/license.html"},
#endif
#ifdef SF_HAVE_CIVETWEB
    {"civetweb", "MIT", "the page of splatfit live and splatfit view",
     "https://github.com/civetweb/civetweb/blob/master/LICENSE.md"},
#endif
    {"libgcc", "GPL-3.0-or-later with GCC-exception-3.1", "the compiler's own",
     "https://gcc.gnu.org/onlinedocs/libstdc++/manual/license.html"},
    {"glibc", "LGPL-2.1-or-later", "the C library",
     "https://sourceware.org/git/?p=glibc.git;a=blob;f=LICENSES"},
};

void app_licences(void) {
#ifdef SF_STATIC
    const char *how = "linked into it";
#else
    const char *how = "linked at run time";
#endif
    printf("splatfit %s: MIT, Copyright (c) 2026 The splatfit authors\n\nOf others, %s:\n", sf_version(),
           how);
    for (size_t i = 0; i < sizeof linked / sizeof *linked; i++)
        printf("  %-14s %s: %s\n  %-14s %s\n", linked[i].name, linked[i].terms, linked[i].what, "",
               linked[i].where);
}
