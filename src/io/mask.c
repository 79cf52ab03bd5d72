/* mask.c - see mask.h. */
#include "mask.h"
#include "paths.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Which file. */

/* "folder/name" without the last `cut` bytes, and `ending` behind; NULL: no memory. */
static char *candidate(sf_context *ctx, const char *folder, const char *name, size_t cut,
                       const char *ending) {
    size_t size = strlen(folder) + strlen(name) + strlen(ending) + 2;
    char *path = sf_alloc(ctx, size, 1);
    if (path) snprintf(path, size, "%s/%.*s%s", folder, (int)(strlen(name) - cut), name, ending);
    return path;
}

static size_t ending_of(const char *name) {
    const char *slash = strrchr(name, '/'), *dot = strrchr(slash ? slash : name, '.');
    return dot ? strlen(dot) : 0;
}

/* COLMAP's and those of others; Metashape exports {filename}_mask, RealityScan NAME.mask.png. */
static const struct {
    int whole; /* the picture's name with its own ending before this one */
    const char *ending;
} forms[] = {{1, ".png"},       {0, ".png"},      {1, ""},          {0, ".PNG"},      {0, ".jpg"},
             {0, ".jpeg"},      {0, ".JPG"},      {1, ".PNG"},      {0, "_mask.png"}, {0, "_mask.jpg"},
             {0, "_mask.jpeg"}, {0, "_mask.PNG"}, {0, "_mask.JPG"}, {1, ".mask.png"}, {0, ".mask.png"}};

sf_status sf_mask_look_for(sf_context *ctx, const char *folder, const char *name, char **mask) {
    for (size_t i = 0; i < sizeof forms / sizeof *forms; i++) {
        char *path = candidate(ctx, folder, name, forms[i].whole ? 0 : ending_of(name), forms[i].ending);
        if (!path) return SF_ERR_MEMORY;
        if (sf_is_file(path)) {
            *mask = path;
            return SF_OK;
        }
        sf_free(ctx, path);
    }
    return SF_OK;
}

static sf_status find_for(sf_context *ctx, const char *folder, sf_entry *e, size_t *found) {
    const char *slash = strchr(e->name, '/');
    sf_status status = sf_mask_look_for(ctx, folder, e->name, &e->mask);
    if (!status && !e->mask && slash) status = sf_mask_look_for(ctx, folder, slash + 1, &e->mask);
    *found += e->mask != NULL;
    return status;
}

/* NULL if the folder does not exist. */
static sf_status find_folder(sf_project *p, const char *wanted, char **folder) {
    *folder = sf_path_join(p->ctx, p->folder, wanted ? wanted : "masks");
    if (!*folder) return SF_ERR_MEMORY;
    if (sf_is_folder(*folder)) return SF_OK;
    sf_status status = sf_check_link(p->ctx, *folder);
    sf_free(p->ctx, *folder);
    *folder = NULL;
    if (status) return status;
    if (!wanted) return SF_OK;
    if (!sf_is_folder(wanted))
        return sf_fail(p->ctx, SF_ERR_IO, "%s/%s: no such folder of masks", p->folder, wanted);
    *folder = sf_text_copy(p->ctx, wanted);
    return *folder ? SF_OK : SF_ERR_MEMORY;
}

/* A folder that the user named must hold a mask; one that is only there is warned of. */
static sf_status tell_of_none(sf_project *p, const char *folder, int must) {
    static const char format[] =
        "%s: no mask fits a picture: looked for %s.png, %.*s.png, %.*s_mask.png and .jpg";
    const char *name = p->entries[0].name;
    int stem = (int)(strlen(name) - ending_of(name));
    if (must) return sf_fail(p->ctx, SF_ERR_IO, format, folder, name, stem, name, stem, name);
    sf_log(p->ctx, SF_LOG_WARNING, format, folder, name, stem, name, stem, name);
    return SF_OK;
}

static sf_status find_all(sf_project *p, const char *folder, int must) {
    size_t found = 0, open = 0;
    sf_status status = SF_OK;
    for (size_t i = 0; !status && i < p->count; i++) {
        if (p->entries[i].mask) continue;
        open++;
        status = find_for(p->ctx, folder, &p->entries[i], &found);
    }
    if (status || !open) return status;
    if (!found) return tell_of_none(p, folder, must);
    sf_log(p->ctx, SF_LOG_INFO, "%s: masks of %zu of %zu pictures: black is ignored", folder, found, open);
    return SF_OK;
}

static void forget_all(sf_project *p) {
    for (size_t i = 0; i < p->count; i++) {
        sf_free(p->ctx, p->entries[i].mask);
        p->entries[i].mask = NULL;
    }
}

sf_status sf_masks_find(sf_project *p, const sf_load_options *options) {
    if (options->no_masks) {
        forget_all(p);
        return SF_OK;
    }
    char *folder;
    sf_status status = find_folder(p, options->masks, &folder);
    if (!status && folder) status = find_all(p, folder, options->masks != NULL);
    sf_free(p->ctx, folder);
    return status;
}

/* What it does. */

static sf_status make_weights(sf_context *ctx, sf_picture *p) {
    if (p->weight) return SF_OK;
    size_t n = (size_t)p->width * (size_t)p->height;
    p->weight = sf_alloc(ctx, n, 1);
    if (!p->weight) return SF_ERR_MEMORY;
    memset(p->weight, 255, n);
    return SF_OK;
}

/* COLMAP ignores 0 and uses all other values, so masks of 0 and 1, or of label numbers, exist. A mask without
 * a value of 128 or more is read in this way. */
static void spread_labels(sf_picture *mask) {
    size_t n = (size_t)mask->width * (size_t)mask->height;
    for (size_t i = 0; i < n; i++)
        if (mask->rgb[i] >= 128) return;
    for (size_t i = 0; i < n; i++)
        if (mask->rgb[i]) mask->rgb[i] = 255;
}

static sf_status check_mask(const sf_picture *mask, sf_picture *p) {
    if (sf_is_same_shape(mask->width, mask->height, p->width, p->height)) return SF_OK;
    snprintf(p->fault, sizeof p->fault, "mask: size: %d x %d is not the picture's %d x %d, nor its shape",
             mask->width, mask->height, p->width, p->height);
    return SF_ERR_FORMAT;
}

static sf_status lower_weights(sf_context *ctx, const sf_picture *mask, sf_picture *p) {
    sf_status status = check_mask(mask, p);
    if (status) return status;
    if (make_weights(ctx, p)) return SF_ERR_MEMORY;
    size_t width = (size_t)p->width, height = (size_t)p->height;
    for (size_t y = 0; y < height; y++) {
        const uint8_t *row =
            mask->rgb + (2 * y + 1) * (size_t)mask->height / (2 * height) * (size_t)mask->width;
        for (size_t x = 0; x < width; x++) {
            uint8_t value = row[(2 * x + 1) * (size_t)mask->width / (2 * width)];
            if (value < p->weight[y * width + x]) p->weight[y * width + x] = value;
        }
    }
    return SF_OK;
}

/* What is wrong with the mask is what is wrong with the picture. */
static void pass_fault_on(const sf_picture *mask, sf_picture *p) {
    snprintf(p->fault, sizeof p->fault, "mask: %.*s", SF_PICTURE_FAULT_BYTES - 7, mask->fault);
}

sf_status sf_mask_look(sf_context *ctx, const char *path, sf_picture *p) {
    sf_picture mask;
    sf_status status = sf_picture_look(ctx, path, 1, &mask);
    if (status) pass_fault_on(&mask, p);
    return status ? status : check_mask(&mask, p);
}

sf_status sf_mask_apply(sf_context *ctx, const char *path, sf_picture *p) {
    sf_picture mask;
    sf_status status = sf_picture_load(ctx, path, &mask);
    if (!status) spread_labels(&mask);
    if (status)
        pass_fault_on(&mask, p);
    else
        status = lower_weights(ctx, &mask, p);
    sf_picture_free(ctx, &mask);
    return status;
}

sf_status sf_mask_border(sf_context *ctx, int border, sf_picture *p) {
    if (make_weights(ctx, p)) return SF_ERR_MEMORY;
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++)
            if (x < border || y < border || x >= p->width - border || y >= p->height - border)
                p->weight[(size_t)y * (size_t)p->width + (size_t)x] = 0;
    return SF_OK;
}

static void blend(const float background[3], sf_picture *p) {
    size_t n = (size_t)p->width * (size_t)p->height;
    for (size_t c = 0; c < 3; c++) {
        uint8_t *plane = p->rgb + c * n;
        unsigned behind = (unsigned)lroundf(255 * background[c]);
        for (size_t i = 0; i < n; i++) {
            unsigned a = p->weight[i];
            plane[i] = (uint8_t)((plane[i] * a + behind * (255 - a) + 127) / 255);
        }
    }
}

static sf_alpha meaning(const sf_load_options *options, int blends) {
    if (options->alpha != SF_ALPHA_AUTO) return options->alpha;
    return blends ? SF_ALPHA_BLEND : SF_ALPHA_MASK;
}

int sf_alpha_is_weight(const sf_load_options *options, int blends) {
    return meaning(options, blends) == SF_ALPHA_MASK;
}

void sf_alpha_apply(sf_context *ctx, const sf_load_options *options, int blends, sf_picture *p) {
    sf_alpha alpha = meaning(options, blends);
    if (!p->weight || alpha == SF_ALPHA_MASK) return;
    if (alpha == SF_ALPHA_BLEND) blend(options->background, p);
    sf_free(ctx, p->weight);
    p->weight = NULL;
}

const char *sf_alpha_says(const sf_load_options *options, int blends) {
    switch (meaning(options, blends)) {
    case SF_ALPHA_BLEND:
        return "blended over the background";
    case SF_ALPHA_IGNORE:
        return "not used";
    default:
        return "what is transparent is ignored";
    }
}
