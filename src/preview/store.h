/* store.h - what was published, under one lock: written by the program, read by the server's threads. */
#ifndef SF_PREVIEW_STORE_H
#define SF_PREVIEW_STORE_H

#include <pthread.h>

#include "../base/context.h"
#include "messages.h"

#include <splatfit/model.h>

enum {
    SF_PREVIEW_COMMANDS = 16,      /* that wait at most */
    SF_PREVIEW_PARTS = 5,          /* bits of sf_preview_part */
    SF_PREVIEW_POINTS = 1024,      /* of the history */
    SF_PREVIEW_MOST_STATUS = 65536 /* bytes of a status */
};

/* A picture: the newest pixels, and the newest of them that were made a JPEG. */
typedef struct sf_preview_shot {
    uint8_t *rgb;
    size_t capacity;
    int width, height;
    uint64_t version;      /* 0: none */
    pthread_mutex_t coder; /* guards what follows; taken before the store's lock */
    uint8_t *pixels;       /* a copy of rgb, which may change meanwhile */
    size_t pixels_capacity;
    uint8_t *jpeg;
    size_t jpeg_size;
    uint64_t jpeg_version;
} sf_preview_shot;

/* What is read of a model: the bytes of a .splat, and of the SH what it leaves out (model_file.h). */
typedef enum sf_preview_piece { SF_PREVIEW_SPLATS, SF_PREVIEW_SH, SF_PREVIEW_PIECES } sf_preview_piece;

typedef struct sf_preview_splats {
    uint8_t *data[SF_PREVIEW_PIECES];
    size_t capacity[SF_PREVIEW_PIECES], bytes[SF_PREVIEW_PIECES];
    size_t count; /* Gaussians */
    int antialiased, sh_degree;
    uint64_t version; /* 0: none */
} sf_preview_splats;

/* A moment of the quality; what is not known is NaN. */
typedef struct sf_preview_point {
    double seconds, held_out_psnr, psnr_tracked;
} sf_preview_point;

typedef struct sf_preview_store {
    sf_context *ctx;
    pthread_mutex_t lock;
    char *status; /* JSON, or NULL */
    int buttons;
    sf_preview_shot camera, render;
    pthread_mutex_t modelling; /* one sf_preview_set_model at a time; taken before lock */
    sf_preview_splats models[2];
    int newest;                   /* of the two */
    double published, old_served; /* clock, s: the newest model, and when the one before was last read from */
    sf_preview_point points[SF_PREVIEW_POINTS];
    int point_count;
    uint64_t history;              /* changes with the points */
    double seen[SF_PREVIEW_PARTS]; /* clock, s: when a client last asked for bit i of sf_preview_part */
    sf_preview_command commands[SF_PREVIEW_COMMANDS];
    int first_command, command_count;
} sf_preview_store;

sf_status sf_store_create(sf_context *ctx, sf_preview_store **store);
void sf_store_destroy(sf_preview_store **store);

/* What sf_preview_wants and the others of preview.h do. */
int sf_store_wants(sf_preview_store *s, int parts);
sf_status sf_store_set_status(sf_preview_store *s, const char *json);
sf_status sf_store_set_picture(sf_preview_store *s, sf_preview_part part, int width, int height,
                               const uint8_t *rgb);
sf_status sf_store_set_model(sf_preview_store *s, const sf_model *model, int sh_degree);
int sf_store_take_command(sf_preview_store *s, sf_preview_command *command);

/* A client looks at `parts`. */
void sf_store_look(sf_preview_store *s, int parts);

/* SF_ERR_UNSUPPORTED: the status offers no buttons; SF_ERR_TIMEOUT: as many wait as can. No message. */
sf_status sf_store_give_command(sf_preview_store *s, sf_preview_command command);

/* The newest of all as JSON, and the history; sf_free them. NULL: no memory. `head` is put first: members of
 * the object, each followed by a comma. */
char *sf_store_status_json(sf_preview_store *s, const char *head);
char *sf_store_history_json(sf_preview_store *s);

/* A copy of the newest picture as JPEG, and its version; sf_free it. SF_ERR_EMPTY: there is none (no
 * message). */
sf_status sf_store_jpeg(sf_preview_store *s, sf_preview_part part, uint8_t **jpeg, size_t *size,
                        uint64_t *version);

/* Version of the newest model, 0: no model yet. */
uint64_t sf_store_model(sf_preview_store *s);

/* Size of a piece of the model of that version, 0: no longer here. */
size_t sf_store_model_bytes(sf_preview_store *s, uint64_t version, sf_preview_piece piece);

/* Copies bytes at..at+size-1 of a piece of the model of that version. 0: it is no longer here. */
int sf_store_model_read(sf_preview_store *s, uint64_t version, sf_preview_piece piece, size_t at, size_t size,
                        uint8_t *data);

#endif
