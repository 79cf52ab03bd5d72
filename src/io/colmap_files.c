/* colmap_files.c - see colmap_files.h. */
#include "colmap_files.h"

#include <string.h>

#include "../base/file.h"
#include "paths.h"

const sf_colmap_names sf_colmap_cameras = {"cameras.bin", "cameras.txt"};
const sf_colmap_names sf_colmap_images = {"images.bin", "images.txt"};
const sf_colmap_names sf_colmap_points = {"points3D.bin", "points3D.txt"};

const char *sf_colmap_file_in(const char *folder, const sf_colmap_names *names) {
    if (sf_holds_file(folder, names->binary)) return names->binary;
    return sf_holds_file(folder, names->text) ? names->text : NULL;
}

int sf_colmap_holds_model(const char *folder) {
    return sf_colmap_file_in(folder, &sf_colmap_cameras) || sf_colmap_file_in(folder, &sf_colmap_images);
}

int sf_colmap_is_text(const char *path) { return !strcmp(path + strlen(path) - 4, ".txt"); }
