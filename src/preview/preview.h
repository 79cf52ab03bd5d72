/* preview.h - a page in the browser that shows a model while it grows, and the camera that looks at it.
 *
 * The program publishes what is newest, threads of the server's own hand it to whoever looks, and the page's
 * buttons come back as commands. What is published is copied: no call waits for the network. Calls may come
 * from any thread, sf_preview_close from one that is the last. No scene is fitted or changed here.
 */
#ifndef SF_PREVIEW_PREVIEW_H
#define SF_PREVIEW_PREVIEW_H

#include <stdint.h>

#include <splatfit/model.h>

#include "messages.h"

typedef struct sf_preview sf_preview;

typedef struct sf_preview_options {
    const char *listen; /* "ADDRESS:PORT" with an address in figures, or a port alone: "127.0.0.1:8090",
                           "0.0.0.0:8090", "[::1]:0", "8090" (of 127.0.0.1). Port 0: one that is free. NULL:
                           "127.0.0.1:8090" */
    const char *token;  /* what every client must bring, 8..64 of A-Z a-z 0-9 - _; NULL: nothing on a loopback
                           address, else 128 random bits */
    const char *title;  /* of the page, for example the project's name; NULL: none */
} sf_preview_options;

/* Opens the address and starts to serve. options NULL: all as if NULL. The context outlives the preview.
 * SF_ERR_ARGUMENT: listen or token is not of its form; SF_ERR_IO: the address is taken or not this machine's;
 * SF_ERR_UNSUPPORTED: not built with civetweb; SF_ERR_MEMORY. On failure *preview is NULL. SIGPIPE is ignored
 * from then on, as the library of the server has it. */
sf_status sf_preview_open(sf_context *ctx, const sf_preview_options *options, sf_preview **preview);

/* Ends every connection, waits for the threads (at most some seconds) and sets *preview to NULL. NULL is
 * allowed. */
void sf_preview_close(sf_preview **preview);

/* What to type into a browser: with the token, and where all addresses are listened on, with one by which
 * other machines reach this. Stands until the preview is closed. */
const char *sf_preview_url(const sf_preview *preview);

/* Whether a client looks at any of `parts` (a sum of sf_preview_part) and can take something newer: 0 or 1.
 * Without a client there is no need to make pictures. */
int sf_preview_wants(sf_preview *preview, int parts);

/* The newest figures, one JSON object; what stood before is replaced. The page knows
 *
 *     seconds               of the run
 *     state                 "waiting for the board", "fitting", "lost", "paused", "done", ...: any text
 *     message               one line for the user, any text
 *     gaussians, steps, steps_per_second
 *     frames_per_second, tracked_per_second, dropped, keyframes
 *     held_out_psnr, psnr_tracked                   dB; kept over time for the chart, with `seconds`
 *     memory_mb
 *     exposure_locked                               true or false: whether the button locks or unlocks
 *     pose                  {"R_cw": [9], "t_cw": [3], "fx", "fy", "cx", "cy", "width", "height"} of the
 *                           camera's picture, as sf_camera (camera.h)
 *     pose_from             "board", "track", "file", "known" or "none"
 *     corners               [[x, y], ...] px, of a board's tags in the camera's picture, four a tag
 *     advice                what the user should do, any text; null: nothing
 *     coverage              {"width", "height", "values": a text of width x height digits 0 (badly covered)
 * to 9 or '.' (not known), "worst": [x, y, z] of the world, or null, "worst_says": any text}, over the
 * camera's picture; published where sf_preview_wants(SF_PREVIEW_COVERAGE) background            [3] 0..1,
 * behind the model that the page draws; missing: black throttled             true: the machine slows itself
 * down still                 true: a finished model, of which the page shows nothing but the model views
 * [pose, ...], each as `pose`: places to choose from buttons               true: commands are taken; missing
 * or false: the page shows no buttons
 *
 * and does with any of them missing. SF_ERR_ARGUMENT: not an object, or longer than 64 KiB; SF_ERR_MEMORY:
 * what stood before stands. */
sf_status sf_preview_set_status(sf_preview *preview, const char *json);

/* The newest picture, [height][width][3], sRGB values; `part` is SF_PREVIEW_CAMERA or SF_PREVIEW_RENDER. It
 * becomes a JPEG when a client asks. SF_ERR_ARGUMENT: another part, a size out of 1..16384; SF_ERR_MEMORY. */
sf_status sf_preview_set_picture(sf_preview *preview, sf_preview_part part, int width, int height,
                                 const uint8_t *rgb);

/* The newest model, as the records of a .splat: 32 bytes a Gaussian, those of most weight first; and of its
 * SH the bands 1 to sh_degree (0..3, or as many as the model has) in 16, 32 or 48 bytes more. Two models are
 * kept, this and the one before, which clients may be reading. SF_ERR_MEMORY: what stood before stands. */
sf_status sf_preview_set_model(sf_preview *preview, const sf_model *model, int sh_degree);

/* The most bands whose bytes, of `count` Gaussians, are at most `bytes`: what a sender of many models a
 * minute can afford. */
int sf_preview_sh_within(size_t count, size_t bytes);

/* Takes the oldest waiting command of a client: returns 1, or 0 if no command waits. At most 16 wait;
 * the page is told of those beyond. */
int sf_preview_take_command(sf_preview *preview, sf_preview_command *command);

#endif
