/* args.h - the command line: one table a command drives parsing and help. */
#ifndef APP_ARGS_H
#define APP_ARGS_H

#include <stddef.h>
#include <stdio.h>

typedef struct arg_option {
    const char *name;    /* without the dashes */
    char letter;         /* short form, 0: none */
    const char *metavar; /* of its value; NULL: takes none */
    const char *text;
} arg_option;

enum { ARGS_MOST = 128, ARGS_POSITIONAL = 1024 };

/* What was typed. */
typedef struct args {
    const struct command *command;
    const char *positional[ARGS_POSITIONAL];
    int positionals;
    struct {
        const char *name, *value; /* value "" for an option that takes none */
    } given[ARGS_MOST];
    int givens;
} args;

typedef struct command {
    const char *name;
    const char *synopsis; /* after "splatfit NAME " */
    const char *summary;
    const arg_option *const *tables; /* each ended by an option without a name; NULL ends the list */
    int least, most;                 /* positional arguments */
    int with_fit_options;            /* takes the hyperparameters of fitter.h too */
    int (*run)(const args *a);
} command;

/* Exit codes; 128 + the number of the signal that ended the work early is another. */
enum { EXIT_FINE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

/* Parses what follows the command's name. 0, or EXIT_USAGE after one line on standard error. */
int args_parse(args *a, const command *cmd, int argc, char **argv);

/* The value of an option, "" for one that takes none, NULL if it was not given. The last one counts. */
const char *args_value(const args *a, const char *name);

/* An integer option: *value is left alone if it was not given. 0, or EXIT_USAGE after one line. */
int args_int(const args *a, const char *name, long least, long most, int *value);

/* An option of `count` numbers, finite, set apart by commas: *values are left alone if it was not given. 0,
 * or EXIT_USAGE after one line. */
int args_numbers(const args *a, const char *name, int count, double *values);

/* Whether what is written there may be coloured: a terminal that can, and no NO_COLOR. */
int args_colored(FILE *to);

/* From now on errors name the rank and its host. */
void args_speak_as(int rank, const char *host);
/* "rank 1 on HOST: ", or "". */
const char *args_speaker(void);

/* Prints one line on standard error, "splatfit NAME: ..." (cmd NULL: "splatfit: ..."); adds the newline.
 * Returns EXIT_FAILED. */
int args_error(const command *cmd, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Whether what was typed may stand for a word: its beginning, or one or two letters put in, left out or
 * changed. */
int args_near(const char *typed, const char *word);

/* help.c: what the tables say, on standard output: for people, as a page of the manual without what is
 * written by hand, and for a shell that completes, one "--name VALUES" a line. */
/* Letters of a summary's first sentence, without its stop. */
int help_first(const char *summary);
void help_text(const command *cmd);
void help_man(const command *cmd);
void help_words(const command *cmd);

#endif
