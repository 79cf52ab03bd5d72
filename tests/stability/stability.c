/* stability.c - runs the experiments and writes what they showed; fails where a figure is beyond its bound.
 */
#include "stability.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char usage[] =
    "usage: stability [--quick] [--only ID,ID,..] [--json FILE] [--html FILE] [--list]\n"
    "  --quick  the rows that make test runs, as it runs them\n"
    "  --only   these rows alone\n"
    "  --list   says which rows there are\n"
    "SPLATFIT_DATA names the folder of real scenes; rows that need them are skipped without it.\n";

typedef struct options {
    const char *only, *json, *html;
    int quick, list;
} options;

static int parse(int argc, char **argv, options *o) {
    for (int i = 1; i < argc; i++) {
        const char **value = !strcmp(argv[i], "--only")   ? &o->only
                             : !strcmp(argv[i], "--json") ? &o->json
                             : !strcmp(argv[i], "--html") ? &o->html
                                                          : NULL;
        if (value && i + 1 < argc)
            *value = argv[++i];
        else if (!value && !strcmp(argv[i], "--quick"))
            o->quick = 1;
        else if (!value && !strcmp(argv[i], "--list"))
            o->list = 1;
        else {
            fprintf(stderr, "stability: %s: %s\n%s", argv[i],
                    value ? "wants a value" : "there is no such option", usage);
            return 0;
        }
    }
    return 1;
}

/* Takes the rows wanted; how many, or -1 where an id names none. */
static int choose(const options *o, const stab_row **wanted) {
    int count = 0;
    if (!o->only) {
        for (size_t i = 0; i < stab_row_count(); i++)
            if (!o->quick || stab_row_at(i)->quick) wanted[count++] = stab_row_at(i);
        return count;
    }
    for (const char *id = o->only;; id += strcspn(id, ",") + 1) {
        size_t length = strcspn(id, ",");
        const stab_row *row = stab_row_find(id, length);
        if (!row || (size_t)count == stab_row_count()) {
            fprintf(stderr, "stability: --only: \"%.*s\" is %s\n", (int)length, id,
                    row ? "one too many" : "no row; --list names them");
            return -1;
        }
        wanted[count++] = row;
        if (!id[length]) return count;
    }
}

static int report(const options *o, const stab_run *runs, size_t count) {
    sf_context *ctx = test_context();
    sf_status status = SF_OK;
    if (o->json) status = stab_write_json(ctx, runs, count, o->json);
    if (!status && o->html) status = stab_write_page(ctx, runs, count, o->html);
    if (status) fprintf(stderr, "stability: %s\n", sf_last_error(ctx));
    sf_context_destroy(&ctx);
    return !status;
}

static int execute(const options *o, const stab_row **wanted, size_t count) {
    stab_run *runs = calloc(count ? count : 1, sizeof *runs);
    size_t failed = 0, known = 0, skipped = 0;
    assert_non_null(runs);
    printf("row   failure and figures %44s %9s %10s %-9s %9s\n", "", "value", "bound", "unit", "textbook");
    for (size_t i = 0; i < count; i++) {
        stab_execute(wanted[i], o->quick ? STAB_QUICK : STAB_WHOLE, &runs[i]);
        stab_print(&runs[i]);
        failed += !stab_run_is_known(&runs[i]);
        known += !stab_run_holds(&runs[i]) && stab_run_is_known(&runs[i]);
        skipped += runs[i].skipped[0] != 0;
    }
    printf("%zu rows, %zu failed, %zu more known to, %zu skipped\n", count, failed, known, skipped);
    int written = report(o, runs, count);
    for (size_t i = 0; i < count; i++) stab_free(&runs[i]);
    free(runs);
    return written && !failed;
}

int main(int argc, char **argv) {
    options o = {0};
    if (!parse(argc, argv, &o)) return 2;
    if (o.list) {
        for (size_t i = 0; i < stab_row_count(); i++)
            printf("%-4s %s%s\n", stab_row_at(i)->id, stab_row_at(i)->failure,
                   stab_row_at(i)->quick ? " (quick)" : "");
        return 0;
    }
    const stab_row **wanted = calloc(stab_row_count(), sizeof *wanted);
    assert_non_null(wanted);
    int count = choose(&o, wanted), fine = count >= 0 && execute(&o, wanted, (size_t)count);
    free(wanted);
    return count < 0 ? 2 : !fine;
}
