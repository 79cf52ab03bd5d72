/* vivid.h - the kernel's simulated capture devices: their knobs, and frames written into an output that come
 * out of the capture device beside it. */
#ifndef VIVID_H
#define VIVID_H

#include <stdint.h>

#include <splatfit/source.h>

/* Nodes that tests/capture/init.sh makes: pairs of capture and output, of one plane and of several. */
#define VIVID_CAPTURE        "/dev/video0"
#define VIVID_OUTPUT         "/dev/video1"
#define VIVID_CAPTURE_MPLANE "/dev/video2"
#define VIVID_OUTPUT_MPLANE  "/dev/video3"

/* Inputs of a capture node. */
enum { VIVID_WEBCAM, VIVID_HDMI };

/* Sets a control by its name in the driver, for example "Loop Video". */
void vivid_set(const char *node, const char *control, int value);
int vivid_get(const char *node, const char *control);
void vivid_set_input(const char *node, int input);
/* Sets the timings of an HDMI input or output to the first that the node knows of this size. */
void vivid_set_timings(const char *node, int width, int height);
/* "DRIVER of a platform device": unbinds it from its driver, or binds it again. */
void vivid_bind(const char *device, int bind);

/* Puts both nodes of a pair at HDMI of that size, the loop on, the text over the picture off. */
void vivid_loop(const char *capture, const char *output, int width, int height);
/* The capture node at its webcam input of 25 frames a second, faults and loop off. */
void vivid_webcam(const char *capture);

/* Streams numbered frames of pattern.h into an output node; the first two are put at once. */
typedef struct vivid_feed vivid_feed;
vivid_feed *vivid_feed_open(const char *node, uint32_t fourcc, sf_pixel_format format, int width, int height);
/* Puts the next frame, waiting for a free buffer; its id. */
uint32_t vivid_feed_put(vivid_feed *feed);
/* The same with a picture in a pattern's place: rows of RGB24, for a feed of that format. */
void vivid_feed_show(vivid_feed *feed, const uint8_t *rgb);
/* Frames put so far. */
uint32_t vivid_feed_count(const vivid_feed *feed);
void vivid_feed_close(vivid_feed *feed);

#endif
