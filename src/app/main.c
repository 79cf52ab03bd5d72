/* main.c - the program: finds the subcommand. */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "app.h"

static const command *const commands[] = {
    &command_fit,     &command_render,  &command_eval,  &command_info,      &command_devices,
    &command_cameras, &command_capture, &command_board, &command_calibrate, &command_bench,
    &command_chart,   &command_convert, &command_prune, &command_live,      &command_view};
enum { COMMANDS = sizeof commands / sizeof *commands };

enum { LARGE_BLOCK = 1 << 20 /* bytes */ };

static const struct {
    int code;
    const char *meaning;
} exit_codes[] = {
    {EXIT_FINE, "done"},
    {EXIT_FAILED, "failed; a line on standard error names the file, the field and the value"},
    {EXIT_USAGE, "wrong usage: an option or an argument; nothing was done"},
    {128 + SIGHUP, "stopped by SIGHUP; fit, capture and live have written what there was"},
    {128 + SIGINT, "stopped by SIGINT (Ctrl-C); likewise"},
    {128 + SIGTERM, "stopped by SIGTERM; likewise"},
};
enum { EXIT_CODES = sizeof exit_codes / sizeof *exit_codes };

static void print_help(void) {
    printf("splatfit %s - fits 3D Gaussian scenes to pictures\n\n", sf_version());
    for (size_t i = 0; i < COMMANDS; i++) {
        printf("  splatfit %-9s %s\n  %-18s %.*s\n", commands[i]->name, commands[i]->synopsis, "",
               help_first(commands[i]->summary), commands[i]->summary);
    }
    printf("\nsplatfit COMMAND --help lists a command's options; splatfit --version prints the version,\n"
           "splatfit --licences what is linked and under which terms.\n\nExit codes:\n");
    for (size_t i = 0; i < EXIT_CODES; i++) printf("  %3d  %s\n", exit_codes[i].code, exit_codes[i].meaning);
}

/* The commands and the exit codes, as parts of the page splatfit(1). */
static void man_lists(void) {
    printf(".TH SPLATFIT 1 \"\" \"splatfit %s\" \"splatfit\"\n@DESCRIPTION@\n.SH COMMANDS\n", sf_version());
    for (size_t i = 0; i < COMMANDS; i++)
        printf(".TP\n.BR splatfit\\-%s (1)\n%.*s\n", commands[i]->name, help_first(commands[i]->summary),
               commands[i]->summary);
    printf(".SH EXIT STATUS\n");
    for (size_t i = 0; i < EXIT_CODES; i++)
        printf(".TP\n.B %d\n%s\n", exit_codes[i].code, exit_codes[i].meaning);
}

static void words_of_all(void) {
    for (size_t i = 0; i < COMMANDS; i++) printf("%s\n", commands[i]->name);
    printf("help\n--help\n--version\n--licences\n");
}

static int unknown(const char *name) {
    for (size_t i = 0; i < COMMANDS; i++)
        if (args_near(name, commands[i]->name)) {
            args_error(NULL, "%s: unknown command: is %s meant? (see splatfit --help)", name,
                       commands[i]->name);
            return EXIT_USAGE;
        }
    args_error(NULL, "%s: unknown command (see splatfit --help)", name);
    return EXIT_USAGE;
}

static int run(const command *cmd, int argc, char **argv) {
    args a;
    int error = args_parse(&a, cmd, argc, argv);
    if (error) return error;
    if (args_value(&a, "help")) {
        help_text(cmd);
        return EXIT_FINE;
    }
    return cmd->run(&a);
}

static const command *find_command(const char *name) {
    for (size_t i = 0; i < COMMANDS; i++)
        if (!strcmp(name, commands[i]->name)) return commands[i];
    return NULL;
}

/* help, help COMMAND; for the build and for shells: help --man and help --words, of all or of a command. */
static int help(int argc, char **argv) {
    int man = argc > 0 && !strcmp(argv[0], "--man"), words = argc > 0 && !strcmp(argv[0], "--words");
    const char *about = argc > man + words ? argv[man + words] : NULL;
    const command *cmd = about ? find_command(about) : NULL;
    if (about && !cmd) return unknown(about);
    if (cmd)
        (man ? help_man : words ? help_words : help_text)(cmd);
    else
        (man ? man_lists : words ? words_of_all : print_help)();
    return EXIT_FINE;
}

/* Large blocks lie in mappings of their own, so that what is freed goes back to the system. glibc would soon
 * put them on the heap, where one that is in use keeps all before it. */
static void map_large_blocks(void) {
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, LARGE_BLOCK);
#endif
}

int main(int argc, char **argv) {
    map_large_blocks();
    signal(SIGPIPE,
           SIG_IGN); /* a reader that goes away, a limit on file sizes: a failed write, with its message */
    signal(SIGXFSZ, SIG_IGN);
    if (argc < 2) {
        args_error(NULL, "a command is missing (see splatfit --help)");
        return EXIT_USAGE;
    }
    const char *name = argv[1];
    if (!strcmp(name, "--version")) {
        printf("splatfit %s\n", sf_version());
        return EXIT_FINE;
    }
    if (!strcmp(name, "--licences")) {
        app_licences();
        return EXIT_FINE;
    }
    if (!strcmp(name, "--help") || !strcmp(name, "-h") || !strcmp(name, "help"))
        return help(argc - 2, argv + 2);
    const command *cmd = find_command(name);
    return cmd ? run(cmd, argc - 2, argv + 2) : unknown(name);
}
