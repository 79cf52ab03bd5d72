/* parts.c - which libraries this program was built with, and what it lacks without the others. */
#include <stdio.h>
#include <string.h>

#include "app.h"

#ifndef SF_PARTS
#define SF_PARTS "" /* "module=version ...", as pkg-config says it */
#endif

typedef struct part {
    const char *module, *what, *package;
} part;

static const part parts[] = {
    {"libturbojpeg", "JPEG pictures", "libturbojpeg0-dev"},
    {"spng", "PNG pictures", "libspng-dev"},
    {"jansson", "JSON", "libjansson-dev"},
    {"zlib", "compression", "zlib1g-dev"},
    {"apriltag", "boards", "libapriltag-dev"},
    {"libcamera", "libcamera: sources", "libcamera-dev"},
    {"libexif", "the focal length that photos tell", "libexif-dev"},
    {"libwebp", ".sog", "libwebp-dev"},
    {"libzip", "projects in a .zip", "libzip-dev"},
    {"libzstd", ".spz of version 4", "libzstd-dev"},
    {"ompi-c", "fits on several machines (make MPI=openmpi)", "libopenmpi-dev"},
    {"mpich", "fits on several machines (make MPI=mpich)", "libmpich-dev"},
    {"civetweb", "the page in the browser", "libcivetweb-dev"},
};

/* What follows "module=" in SF_PARTS, and its length; 0: the module is not built in. */
static int find_version(const char *module, const char **version) {
    size_t length = strlen(module);
    for (const char *at = SF_PARTS; *at; at += strspn(at, " ")) {
        size_t word = strcspn(at, " ");
        if (word > length && !strncmp(at, module, length) && at[length] == '=') {
            *version = at + length + 1;
            return (int)(word - length - 1);
        }
        at += word;
    }
    return 0;
}

void app_parts(void) {
    const char *version;
    printf("splatfit %s, built by %s %s\n", sf_version(),
#ifdef __clang__
           "clang", __clang_version__
#else
           "gcc", __VERSION__
#endif
    );
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        int length = find_version(parts[i].module, &version);
        if (!length)
            printf("%-14s not built in: %s (package %s)\n", parts[i].module, parts[i].what, parts[i].package);
        else if (!strncmp(version, "unknown", 7))
            printf("%-14s built in: %s\n", parts[i].module, parts[i].what);
        else
            printf("%-14s %.*s: %s\n", parts[i].module, length, version, parts[i].what);
    }
}
