/* main.c - the program: finds the subcommand. */
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "app.h"

static const command *const commands[] = {&command_fit, &command_render, &command_eval, &command_info};
enum { COMMANDS = sizeof commands / sizeof *commands };

static void print_help(void) {
    printf("splatfit %s - fits 3D Gaussian scenes to pictures\n\n", sf_version());
    for (size_t i = 0; i < COMMANDS; i++) {
        const char *end = strchr(commands[i]->summary, '.');
        printf("  splatfit %-7s %s\n  %-16s %.*s\n", commands[i]->name, commands[i]->synopsis, "",
               (int)(end ? end - commands[i]->summary : 0), commands[i]->summary);
    }
    printf("\nsplatfit COMMAND --help lists a command's options; splatfit --version prints the version.\n"
           "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 and 143 stopped by SIGINT and SIGTERM.\n");
}

static int run(const command *cmd, int argc, char **argv) {
    args a;
    int error = args_parse(&a, cmd, argc, argv);
    if (error) return error;
    if (args_value(&a, "help")) {
        args_help(cmd);
        return EXIT_FINE;
    }
    return cmd->run(&a);
}

int main(int argc, char **argv) {
    signal(SIGPIPE, SIG_IGN); /* a reader that goes away is a failed write, with its message */
    const char *name = argc > 1 ? argv[1] : "--help";
    if (!strcmp(name, "--version")) {
        printf("splatfit %s\n", sf_version());
        return EXIT_FINE;
    }
    int asked = !strcmp(name, "--help") || !strcmp(name, "-h") || !strcmp(name, "help");
    for (size_t i = 0; i < COMMANDS; i++) {
        if (asked && argc > 2 && !strcmp(argv[2], commands[i]->name)) {
            args_help(commands[i]);
            return EXIT_FINE;
        }
        if (!strcmp(name, commands[i]->name)) return run(commands[i], argc - 2, argv + 2);
    }
    if (asked) {
        print_help();
        return argc > 1 ? EXIT_FINE : EXIT_USAGE;
    }
    fprintf(stderr, "splatfit: %s: unknown command (see splatfit --help)\n", name);
    return EXIT_USAGE;
}
