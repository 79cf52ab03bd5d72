/* guard.c - see guard.h. */
#define _DEFAULT_SOURCE /* getifaddrs' IFF_ flags, strncasecmp */
#include "guard.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

/* ---- Addresses ---- */

/* Decimal digits alone, at most 65535; -1: no such number. */
static int read_port(const char *text) {
    int port = 0;
    if (!*text || strlen(text) > 5) return -1;
    for (; *text; text++) {
        if (*text < '0' || *text > '9') return -1;
        port = 10 * port + (*text - '0');
    }
    return port <= 65535 ? port : -1;
}

/* 4, 6, or 0: no address in figures. What kind of address it is goes to *a. */
static int read_figures(const char *host, sf_preview_address *a) {
    struct in_addr four;
    struct in6_addr six;
    if (inet_pton(AF_INET, host, &four) == 1) {
        a->loopback = ntohl(four.s_addr) >> 24 == 127;
        a->any = four.s_addr == htonl(INADDR_ANY);
        return 4;
    }
    if (inet_pton(AF_INET6, host, &six) != 1) return 0;
    a->ipv6 = 1;
    a->loopback = IN6_IS_ADDR_LOOPBACK(&six);
    a->any = IN6_IS_ADDR_UNSPECIFIED(&six);
    return 6;
}

/* Where the host of HOST:PORT ends, and without brackets; NULL: not of that form. */
static const char *split(const char *text, const char **host, size_t *length) {
    const char *colon = strrchr(text, ':');
    *host = text;
    if (!colon) return NULL;
    *length = (size_t)(colon - text);
    if (*text == '[') {
        if (*length < 2 || colon[-1] != ']') return NULL;
        ++*host;
        *length -= 2;
    }
    return colon + 1;
}

sf_status sf_preview_address_read(sf_context *ctx, const char *listen, sf_preview_address *address) {
    const char *host = "127.0.0.1", *port = listen;
    size_t length = strlen(host);
    sf_preview_address a = {0};
    if (strchr(listen, ':')) port = split(listen, &host, &length);
    a.port = port ? read_port(port) : -1;
    int family = 0;
    if (length < sizeof a.host) {
        memcpy(a.host, host, length);
        family = read_figures(a.host, &a);
    }
    /* An IPv6 address is told from its port by its brackets. */
    if (a.port < 0 || !family || (family == 6) != (*listen == '['))
        return sf_fail(ctx, SF_ERR_ARGUMENT,
                       "listen: \"%s\" is not ADDRESS:PORT, for example 127.0.0.1:8090 or 0.0.0.0:8090",
                       listen);
    *address = a;
    return SF_OK;
}

void sf_preview_address_outside(char host[48]) {
    struct ifaddrs *all;
    strcpy(host, "127.0.0.1");
    if (getifaddrs(&all)) return;
    for (const struct ifaddrs *i = all; i; i = i->ifa_next) {
        if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET) continue;
        if (!(i->ifa_flags & IFF_UP) || i->ifa_flags & IFF_LOOPBACK) continue;
        struct sockaddr_in in;
        memcpy(&in, i->ifa_addr, sizeof in);
        inet_ntop(AF_INET, &in.sin_addr, host, 48);
        break;
    }
    freeifaddrs(all);
}

/* ---- The token ---- */

static const char token_characters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

sf_status sf_preview_token_check(sf_context *ctx, const char *token) {
    size_t length = strlen(token);
    if (length >= SF_PREVIEW_LEAST_TOKEN && length <= SF_PREVIEW_MOST_TOKEN &&
        strspn(token, token_characters) == length)
        return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT,
                   "token: it must be of %d to %d letters, digits, - and _, and has %zu",
                   SF_PREVIEW_LEAST_TOKEN, SF_PREVIEW_MOST_TOKEN, length);
}

sf_status sf_preview_token_make(sf_context *ctx, char token[SF_PREVIEW_MOST_TOKEN + 1]) {
    unsigned char bits[16];
    int fd = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    ssize_t got = fd < 0 ? -1 : read(fd, bits, sizeof bits);
    if (fd >= 0) close(fd);
    if (got != (ssize_t)sizeof bits)
        return sf_fail(ctx, SF_ERR_IO, "token: /dev/urandom: no random bytes to make one from");
    for (size_t i = 0; i < sizeof bits; i++) snprintf(token + 2 * i, 3, "%02x", bits[i]);
    return SF_OK;
}

int sf_preview_token_equal(const char *token, const char *given) {
    char a[SF_PREVIEW_MOST_TOKEN + 1] = "", b[SF_PREVIEW_MOST_TOKEN + 1] = "";
    if (strlen(given) > SF_PREVIEW_MOST_TOKEN) return 0;
    memcpy(a, token, strlen(token));
    memcpy(b, given, strlen(given));
    volatile unsigned char differ = 0;
    for (size_t i = 0; i < sizeof a; i++) differ = differ | (unsigned char)(a[i] ^ b[i]);
    return !differ;
}

/* ---- What browsers say ---- */

static int ends_with(const char *text, const char *end) {
    size_t n = strlen(text), m = strlen(end);
    return n >= m && !strcasecmp(text + n - m, end);
}

/* `name` is the machine's, or begins with it and a dot. */
static int is_machine(const char *name, const char *machine) {
    size_t n = strcspn(machine, ".");
    return n > 0 && !strncasecmp(name, machine, n) && (!name[n] || name[n] == '.');
}

int sf_preview_host_allowed(const char *host, const char *machine, int has_token) {
    char name[256] = "";
    sf_preview_address a = {0};
    const char *from = host;
    size_t length = host ? strlen(host) : 0;
    if (length == 0 || length >= sizeof name) return 0;
    /* The port may be another one, as through a tunnel. */
    if (*host == '[' && host[length - 1] == ']') {
        from++;
        length -= 2;
    } else if (strchr(host, ':')) {
        const char *port = split(host, &from, &length);
        if (!port || read_port(port) < 0) return 0;
    }
    memcpy(name, from, length);
    if (read_figures(name, &a)) return (a.ipv6 != 0) == (*host == '[');
    if (!strcasecmp(name, "localhost") || ends_with(name, ".localhost")) return 1;
    return has_token && is_machine(name, machine);
}

int sf_preview_origin_allowed(const char *origin, const char *host) {
    if (!origin) return 1;
    const char *own = strstr(origin, "://");
    return own && host && !strcasecmp(own + 3, host);
}
