/* rows.c - the list of experiments. */
#include "stability.h"

#include <string.h>

#define ENTRY(id) &stab_row_##id,
static const stab_row *const rows[] = {STAB_ROWS(ENTRY)};

size_t stab_row_count(void) { return sizeof rows / sizeof *rows; }

const stab_row *stab_row_at(size_t index) { return rows[index]; }

const stab_row *stab_row_find(const char *id, size_t length) {
    for (size_t i = 0; i < stab_row_count(); i++)
        if (strlen(rows[i]->id) == length && !memcmp(rows[i]->id, id, length)) return rows[i];
    return NULL;
}
