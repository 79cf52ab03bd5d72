/* pixel_cache.h - pixels that memory does not hold: they lie in a temporary file, and a few pictures at a
 * time in buffers. Safe from any thread. */
#ifndef SF_SCENE_PIXEL_CACHE_H
#define SF_SCENE_PIXEL_CACHE_H

#include "../base/context.h"

typedef struct sf_pixel_cache sf_pixel_cache;

/* Whether pictures of so many bytes go to a file: more than half of the memory budget; 0: not known. */
int sf_pixels_exceed(double bytes, double budget);

/* How many pictures are in buffers at once, of a budget; largest: bytes of the largest. */
size_t sf_pixel_buffers(double budget, double largest);

/* Makes a file without a name, which ends with the process, with room for `bytes`: in TMPDIR, /var/tmp or
 * /tmp, the first that is on a disk and has the room. SF_ERR_IO: no folder is; the message says why. `what`
 * begins the messages, and is copied. */
sf_status sf_pixel_cache_create(sf_context *ctx, const char *what, uint64_t bytes, size_t largest,
                                size_t buffers, sf_pixel_cache **cache);
sf_pixel_cache *sf_pixel_cache_retain(sf_pixel_cache *cache);
void sf_pixel_cache_release(sf_pixel_cache *cache);

/* The folder of the file. */
const char *sf_pixel_cache_folder(const sf_pixel_cache *cache);
/* Bytes that buffers will take beyond those that they have. */
uint64_t sf_pixel_cache_missing(sf_pixel_cache *cache);

/* Appends a picture and its weights (NULL: it has none); *at is its name. SF_ERR_IO: the disk is full, or
 * fails; all later calls say the same. */
sf_status sf_pixel_cache_add(sf_pixel_cache *cache, const uint8_t *rgb, const uint8_t *weight, size_t pixels,
                             uint64_t *at);
/* SF_ERR_IO, with its message once more, where an sf_pixel_cache_add has failed so. */
sf_status sf_pixel_cache_fault(sf_pixel_cache *cache);

/* The `size` bytes of picture `at`, colours before weights, valid until sf_pixel_cache_close. Where all
 * buffers are in use there is one more for the time. SF_ERR_IO, SF_ERR_MEMORY. */
sf_status sf_pixel_cache_open(sf_pixel_cache *cache, uint64_t at, size_t size, const uint8_t **bytes);
void sf_pixel_cache_close(sf_pixel_cache *cache, uint64_t at);

/* Single bytes of a picture, from `offset` on. */
sf_status sf_pixel_cache_peek(sf_pixel_cache *cache, uint64_t at, size_t offset, uint8_t *bytes, size_t size);

/* Has the system read a picture that will be opened soon, without waiting for it. */
void sf_pixel_cache_expect(sf_pixel_cache *cache, uint64_t at, size_t size);

#endif
