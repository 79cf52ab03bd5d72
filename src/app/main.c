/* main.c - the program: finds the subcommand. */
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "app.h"

static const command *const commands[] = {
    &command_fit,     &command_render, &command_eval,      &command_info,  &command_devices,
    &command_capture, &command_board,  &command_calibrate, &command_bench, &command_chart,
    &command_convert, &command_prune,  &command_live};
enum { COMMANDS = sizeof commands / sizeof *commands };

static void print_help(void) {
    printf("splatfit %s - fits 3D Gaussian scenes to pictures\n\n", sf_version());
    for (size_t i = 0; i < COMMANDS; i++) {
        const char *end = strchr(commands[i]->summary, '.');
        printf("  splatfit %-9s %s\n  %-18s %.*s\n", commands[i]->name, commands[i]->synopsis, "",
               (int)(end ? end - commands[i]->summary : 0), commands[i]->summary);
    }
    printf("\nsplatfit COMMAND --help lists a command's options; splatfit --version prints the version.\n"
           "Exit codes: 0 done, 1 failed, 2 wrong usage, 129, 130 and 143 stopped by SIGHUP, SIGINT and "
           "SIGTERM.\n");
}

static int unknown(const char *name) {
    fprintf(stderr, "splatfit: %s: unknown command (see splatfit --help)\n", name);
    return EXIT_USAGE;
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

static const command *find_command(const char *name) {
    for (size_t i = 0; i < COMMANDS; i++)
        if (!strcmp(name, commands[i]->name)) return commands[i];
    return NULL;
}

/* help, help COMMAND */
static int help(const char *about) {
    const command *cmd = about ? find_command(about) : NULL;
    if (about && !cmd) return unknown(about);
    if (cmd)
        args_help(cmd);
    else
        print_help();
    return EXIT_FINE;
}

int main(int argc, char **argv) {
    signal(SIGPIPE,
           SIG_IGN); /* a reader that goes away, a limit on file sizes: a failed write, with its message */
    signal(SIGXFSZ, SIG_IGN);
    if (argc < 2) {
        fprintf(stderr, "splatfit: a command is missing (see splatfit --help)\n");
        return EXIT_USAGE;
    }
    const char *name = argv[1];
    if (!strcmp(name, "--version")) {
        printf("splatfit %s\n", sf_version());
        return EXIT_FINE;
    }
    if (!strcmp(name, "--help") || !strcmp(name, "-h") || !strcmp(name, "help")) return help(argv[2]);
    const command *cmd = find_command(name);
    return cmd ? run(cmd, argc - 2, argv + 2) : unknown(name);
}
