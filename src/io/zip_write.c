/* zip_write.c - see zip_write.h. The layout is that of PKWARE's APPNOTE.TXT, 4.3; nothing is packed. */
#include "zip_write.h"

#include <stdarg.h>
#include <string.h>
#include <zlib.h>

enum { LOCAL = 0x04034b50, CENTRAL = 0x02014b50, END = 0x06054b50, VERSION = 20, EARLIEST_DATE = 0x21 };

/* Bytes from the last one on are for the list at the end. */
static const uint64_t MOST = UINT32_MAX - 4096;

/* Little-endian numbers: "2" is of two bytes, "4" of four. */
static void put_numbers(sf_zip_writer *zip, const char *sizes, ...) {
    va_list values;
    va_start(values, sizes);
    for (; *sizes; sizes++) {
        uint32_t value = va_arg(values, uint32_t);
        uint8_t bytes[4] = {(uint8_t)value, (uint8_t)(value >> 8), (uint8_t)(value >> 16),
                            (uint8_t)(value >> 24)};
        sf_writer_put(zip->w, bytes, (size_t)(*sizes - '0'));
        zip->at += (uint64_t)(*sizes - '0');
    }
    va_end(values);
}

static void put_bytes(sf_zip_writer *zip, const void *data, size_t size) {
    sf_writer_put(zip->w, data, size);
    zip->at += size;
}

sf_status sf_zip_put(sf_zip_writer *zip, const char *name, const void *data, size_t size) {
    if (size > MOST || zip->at + size > MOST)
        return sf_fail(zip->w->ctx, SF_ERR_UNSUPPORTED, "%s: not written: it would be larger than 4 GiB",
                       zip->w->path);
    uint32_t crc = (uint32_t)crc32_z(0, data, size), bytes = (uint32_t)size, length = (uint32_t)strlen(name);
    size_t e = zip->entries++;
    zip->entry[e].name = name;
    zip->entry[e].crc = crc;
    zip->entry[e].size = bytes;
    zip->entry[e].at = (uint32_t)zip->at;
    /* signature, version, flags, method, time, date, CRC, packed size, size, lengths of the name and of more
     */
    put_numbers(zip, "42222244422", (uint32_t)LOCAL, (uint32_t)VERSION, 0u, 0u, 0u, (uint32_t)EARLIEST_DATE,
                crc, bytes, bytes, length, 0u);
    put_bytes(zip, name, length);
    put_bytes(zip, data, size);
    return SF_OK;
}

void sf_zip_end(sf_zip_writer *zip) {
    uint32_t list = (uint32_t)zip->at, entries = (uint32_t)zip->entries;
    for (size_t e = 0; e < zip->entries; e++) {
        uint32_t length = (uint32_t)strlen(zip->entry[e].name);
        /* as above with the version that made it; then lengths of a comment, disk, attributes, where it
         * begins */
        put_numbers(zip, "42222224442222244", (uint32_t)CENTRAL, (uint32_t)VERSION, (uint32_t)VERSION, 0u, 0u,
                    0u, (uint32_t)EARLIEST_DATE, zip->entry[e].crc, zip->entry[e].size, zip->entry[e].size,
                    length, 0u, 0u, 0u, 0u, 0u, zip->entry[e].at);
        put_bytes(zip, zip->entry[e].name, length);
    }
    uint32_t bytes = (uint32_t)zip->at - list;
    put_numbers(zip, "42222442", (uint32_t)END, 0u, 0u, entries, entries, bytes, list, 0u);
}
