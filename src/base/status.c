/* status.c - statuses in words. */
#include <splatfit/status.h>

const char *sf_status_text(sf_status status) {
    switch (status) {
    case SF_OK:
        return "ok";
    case SF_ERR_ARGUMENT:
        return "invalid argument";
    case SF_ERR_MEMORY:
        return "out of memory";
    case SF_ERR_IO:
        return "input or output error";
    case SF_ERR_FORMAT:
        return "malformed file";
    case SF_ERR_UNSUPPORTED:
        return "not supported";
    case SF_ERR_EMPTY:
        return "nothing to work on";
    case SF_ERR_CANCELLED:
        return "cancelled";
    case SF_ERR_TIMEOUT:
        return "timed out";
    case SF_ERR_END:
        return "at the end";
    }
    return "unknown status";
}
