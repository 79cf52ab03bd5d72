/* record_json.h - what a recording's frames.json and transforms.json say. */
#ifndef APP_RECORD_JSON_H
#define APP_RECORD_JSON_H

#include "record_options.h"

/* The head of frames.json. */
json_t *record_head_json(const record_options *o);
/* A frame's entry there, of the picture `name`. */
json_t *record_frame_json(const record_options *o, const sf_frame *f, double sharpness, const char *name);
/* Its end. */
json_t *record_totals_json(const sf_source_counts *s, const record_counts *c);

/* A frame's entry in transforms.json: camera to world with OpenGL's axes (+y up, +z back). */
json_t *record_camera_json(const record_options *o, const sf_frame *f, const char *name);

#endif
