/* serve.h - the preview's side of HTTP: what is asked, by whom, and what is answered. */
#ifndef SF_PREVIEW_SERVE_H
#define SF_PREVIEW_SERVE_H

#include <stdatomic.h>

#include "guard.h"
#include "store.h"

struct mg_context;

typedef struct sf_preview_server {
    sf_context *ctx;
    sf_preview_store *store;
    sf_preview_address address;              /* its port is the one in use, once started */
    char token[SF_PREVIEW_MOST_TOKEN + 1];   /* "": none is asked for */
    char session[SF_PREVIEW_MOST_TOKEN + 1]; /* tells versions of this run from those of another */
    char cookie[32];                         /* its name: of one server of the machine */
    char machine[256];                       /* its name in the network */
    char *head;                              /* of the status: members that never change */
    char complaint[160];                     /* the last line that the library of the server wrote */
    atomic_int listening;
    struct mg_context *http;
} sf_preview_server;

/* The page in one document: page.html with all that it names, put there by page.sh when this is built. */
extern const unsigned char sf_preview_page[];
extern const size_t sf_preview_page_size;

/* Listens at s->address. SF_ERR_UNSUPPORTED: not built with civetweb, or that without IPv6; SF_ERR_IO: the
 * address cannot be had. */
sf_status sf_server_start(sf_preview_server *s);

/* Ends the threads; nothing where it was not started. */
void sf_server_stop(sf_preview_server *s);

#endif
