/* preview.c - see preview.h. */
#define _DEFAULT_SOURCE /* gethostname */
#include "preview.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "../io/model_file.h"
#include "serve.h"

struct sf_preview {
    sf_preview_server server;
    char url[192];
};

/* The members of the status that never change: which run this is, and its title. */
static sf_status make_head(sf_preview_server *s, const char *title) {
    json_t *text = json_string(title ? title : "");
    char *quoted = text ? json_dumps(text, JSON_ENCODE_ANY) : NULL;
    json_decref(text);
    if (!quoted)
        return title && !text ? sf_fail(s->ctx, SF_ERR_ARGUMENT, "title: it is not UTF-8")
                              : sf_fail(s->ctx, SF_ERR_MEMORY, "title: out of memory");
    size_t room = strlen(quoted) + strlen(s->session) + 64;
    s->head = sf_alloc(s->ctx, room, 1);
    if (s->head) snprintf(s->head, room, "\"session\":\"%s\",\"title\":%s,", s->session, quoted);
    free(quoted);
    return s->head ? SF_OK : SF_ERR_MEMORY;
}

static sf_status make_token(sf_preview_server *s, const char *token) {
    if (!token) return s->address.loopback ? SF_OK : sf_preview_token_make(s->ctx, s->token);
    sf_status status = sf_preview_token_check(s->ctx, token);
    if (!status) snprintf(s->token, sizeof s->token, "%s", token);
    return status;
}

static sf_status prepare(sf_preview_server *s, const sf_preview_options *o) {
    sf_status status = sf_preview_address_read(s->ctx, o->listen ? o->listen : "127.0.0.1:8090", &s->address);
    if (!status) status = make_token(s, o->token);
    if (!status) status = sf_preview_token_make(s->ctx, s->session);
    if (!status) status = make_head(s, o->title);
    if (gethostname(s->machine, sizeof s->machine - 1)) *s->machine = 0;
    return status ? status : sf_store_create(s->ctx, &s->store);
}

static void make_url(sf_preview *p) {
    const sf_preview_server *s = &p->server;
    char host[48];
    snprintf(host, sizeof host, "%s", s->address.host);
    if (s->address.any) sf_preview_address_outside(host);
    snprintf(p->url, sizeof p->url, strchr(host, ':') ? "http://[%s]:%d/%s%s" : "http://%s:%d/%s%s", host,
             s->address.port, *s->token ? "?token=" : "", s->token);
}

sf_status sf_preview_open(sf_context *ctx, const sf_preview_options *options, sf_preview **preview) {
    static const sf_preview_options defaults = {0};
    sf_preview *p = sf_calloc(ctx, 1, sizeof *p);
    *preview = NULL;
    if (!p) return SF_ERR_MEMORY;
    p->server.ctx = ctx;
    sf_status status = prepare(&p->server, options ? options : &defaults);
    if (!status) status = sf_server_start(&p->server);
    if (status) {
        sf_preview_close(&p);
        return status;
    }
    make_url(p);
    *preview = p;
    return SF_OK;
}

void sf_preview_close(sf_preview **preview) {
    sf_preview *p = *preview;
    *preview = NULL;
    if (!p) return;
    sf_context *ctx = p->server.ctx;
    sf_server_stop(&p->server);
    sf_store_destroy(&p->server.store);
    sf_free(ctx, p->server.head);
    sf_free(ctx, p);
}

const char *sf_preview_url(const sf_preview *preview) { return preview->url; }

int sf_preview_wants(sf_preview *preview, int parts) { return sf_store_wants(preview->server.store, parts); }

sf_status sf_preview_set_status(sf_preview *preview, const char *json) {
    return sf_store_set_status(preview->server.store, json);
}

sf_status sf_preview_set_picture(sf_preview *preview, sf_preview_part part, int width, int height,
                                 const uint8_t *rgb) {
    return sf_store_set_picture(preview->server.store, part, width, height, rgb);
}

sf_status sf_preview_set_model(sf_preview *preview, const sf_model *model, int sh_degree) {
    return sf_store_set_model(preview->server.store, model, sh_degree);
}

int sf_preview_sh_within(size_t count, size_t bytes) {
    int degree = SF_MAX_SH_DEGREE;
    while (degree > 0 && count > bytes / sf_splat_sh_bytes(degree)) degree--;
    return degree;
}

int sf_preview_take_command(sf_preview *preview, sf_preview_command *command) {
    return sf_store_take_command(preview->server.store, command);
}
