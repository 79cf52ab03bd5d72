/* near_names.c - see near_names.h. */
#include "near_names.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "paths.h"
#include "picture_names.h"

static size_t stem_of(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot && dot > name ? (size_t)(dot - name) : strlen(name);
}

/* The only picture of the folder whose name differs in ending and case alone, in `near`; 0: none, or several.
 */
static int find_near(const char *path, const char *name, char near[NAME_MAX + 1]) {
    DIR *folder = opendir(path);
    const struct dirent *e;
    size_t stem = stem_of(name);
    int count = 0;
    while (folder && (e = readdir(folder))) {
        if (stem_of(e->d_name) != stem || strncasecmp(e->d_name, name, stem)) continue;
        if (!sf_is_picture_name(e->d_name) || !sf_holds_file(path, e->d_name)) continue;
        snprintf(near, NAME_MAX + 1, "%s", e->d_name);
        count++;
    }
    if (folder) closedir(folder);
    return count == 1;
}

sf_status sf_entry_take_near(sf_context *ctx, sf_entry *e) {
    char near[NAME_MAX + 1];
    const char *slash = strrchr(e->path, '/');
    char *folder = sf_path_folder(ctx, e->path);
    sf_status status = folder ? SF_OK : SF_ERR_MEMORY;
    if (folder && find_near(folder, slash ? slash + 1 : e->path, near)) {
        char *path = sf_path_join(ctx, folder, near);
        if (path) {
            sf_free(ctx, e->path);
            e->path = path;
            e->near_name = 1;
        } else {
            status = SF_ERR_MEMORY;
        }
    }
    sf_free(ctx, folder);
    return status;
}

sf_status sf_project_take_near(sf_project *project) {
    const sf_entry *first = NULL;
    size_t count = 0;
    sf_status status = SF_OK;
    for (size_t i = 0; i < project->count && !status; i++) {
        sf_entry *e = &project->entries[i];
        if (!sf_is_file(e->path)) status = sf_entry_take_near(project->ctx, e);
        if (e->near_name && !count++) first = e;
    }
    if (first)
        sf_log(project->ctx, SF_LOG_WARNING,
               "%s: %zu pictures have another ending or another case on disk (first: %s is %s)",
               project->path, count, first->name, first->path);
    return status;
}
