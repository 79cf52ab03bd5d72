/* json_list.h - a JSON file whose long array is written as it grows, so that it never lies in memory. */
#ifndef APP_JSON_LIST_H
#define APP_JSON_LIST_H

#include <jansson.h>
#include <stdint.h>
#include <stdio.h>

/* Under a temporary name until json_list_close. */
typedef struct json_list {
    char *path, *temporary;
    FILE *file;
    size_t entries;
    uint64_t reserved; /* bytes */
    int full;  /* errno where the disk has no room for many more entries; the list can still be ended */
    int error; /* errno of the first failure; later calls do nothing */
} json_list;

/* Begins {...head, "key": [ ; takes the reference of head, an object with at least one entry. */
void json_list_open(json_list *list, const char *folder, const char *name, json_t *head, const char *key);

/* Adds an entry to the array, on a separate line; takes over the reference. */
void json_list_add(json_list *list, json_t *entry);

/* Ends the array and the object with what is in `tail` (may be NULL), syncs and renames; takes the reference.
 * Returns errno of the first failure, or 0; after a failure nothing is at the path. */
int json_list_close(json_list *list, json_t *tail);

#endif
