/* libfuzzer.c - a target under libFuzzer: fuzz --target=NAME, then libFuzzer's own flags and folders. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most);
int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed);

static const fuzz_target *target;

/* libFuzzer passes over what begins with two dashes. */
int LLVMFuzzerInitialize(int *argc, char ***argv) {
    static const char flag[] = "--target=", seeds[] = "--seeds=";
    for (int i = 1; i < *argc; i++) {
        const char *typed = (*argv)[i];
        if (!strncmp(typed, seeds, strlen(seeds))) {
            fuzz_write_seeds(typed + strlen(seeds));
            exit(0);
        }
        if (!strcmp(typed, "--targets")) {
            for (size_t k = 0; fuzz_target_at(k); k++) puts(fuzz_target_at(k)->name);
            exit(0);
        }
        if (!strncmp(typed, flag, strlen(flag))) target = fuzz_target_find(typed + strlen(flag));
    }
    if (target) return 0;
    fprintf(stderr, "fuzz: --target=NAME, --targets or --seeds=FOLDER is missing\n");
    exit(2);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    target->run(data, size);
    return 0;
}

/* Every other change of a checkpoint is one number. One in eight inputs stays with wrong checksums. */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed) {
    int edits = target->run == fuzz_checkpoint && seed % 2;
    size_t changed = edits ? size : LLVMFuzzerMutate(data, size, most);
    if (edits) fuzz_edit_sections(data, size, seed * 2654435761u);
    if (target->repair && seed / 2 % 8) target->repair(data, changed);
    return changed;
}
