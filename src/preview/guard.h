/* guard.h - who may talk to the preview: its address, its token, what browsers say of where they come from.
 */
#ifndef SF_PREVIEW_GUARD_H
#define SF_PREVIEW_GUARD_H

#include "../base/context.h"

enum { SF_PREVIEW_LEAST_TOKEN = 8, SF_PREVIEW_MOST_TOKEN = 64 };

typedef struct sf_preview_address {
    char host[48]; /* in figures, without brackets */
    int port;
    int ipv6;
    int loopback; /* only this machine reaches it */
    int any;      /* all addresses of this machine */
} sf_preview_address;

/* Splits "ADDRESS:PORT" or "PORT". SF_ERR_ARGUMENT: the text is neither. */
sf_status sf_preview_address_read(sf_context *ctx, const char *listen, sf_preview_address *address);

/* An address by which others reach a server that listens on all; "127.0.0.1" where there is no other. */
void sf_preview_address_outside(char host[48]);

/* SF_ERR_ARGUMENT: too short, too long, or of other characters. */
sf_status sf_preview_token_check(sf_context *ctx, const char *token);

/* 32 hexadecimal digits that nobody can guess. SF_ERR_IO: the system gives no random bytes. */
sf_status sf_preview_token_make(sf_context *ctx, char token[SF_PREVIEW_MOST_TOKEN + 1]);

/* Whether they are the same; how long it takes says nothing of where they differ. */
int sf_preview_token_equal(const char *token, const char *given);

/* Whether a request with this Host header was meant for us: an address in figures or localhost, and for a
 * server with a token the machine's name too, with any domain. A page of another site, whose name was bound
 * to our address, sends that name. */
int sf_preview_host_allowed(const char *host, const char *machine, int has_token);

/* Whether the Origin header is the server's own, as `host` is. NULL, as of programs that are no browsers,
 * is. */
int sf_preview_origin_allowed(const char *origin, const char *host);

#endif
