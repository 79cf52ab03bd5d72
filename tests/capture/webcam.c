/* webcam.c - runs the simulated webcam beside a test. */
#include "webcam.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "guest.h"

enum { ARGUMENTS = 16 };

/* Replaces this process, which ends with its parent: a camera without a test would hold the port. */
static _Noreturn void become_webcam(int output, const char *options) {
    char text[256] = "", *arguments[ARGUMENTS + 1] = {(char *)(uintptr_t) "uvcsim"}, *rest = NULL;
    strncat(text, options, sizeof text - 1);
    int count = 1;
    for (char *word = strtok_r(text, " ", &rest); word && count < ARGUMENTS;
         word = strtok_r(NULL, " ", &rest))
        arguments[count++] = word;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(output, STDOUT_FILENO);
    execv("/bin/uvcsim", arguments);
    _exit(127);
}

static void wait_without_node(void) {
    for (int i = 0; i < 100 && node_exists(WEBCAM_NAME); i++) sleep_ms(50);
    check(!node_exists(WEBCAM_NAME), "the unplugged webcam's node stays");
}

void webcam_plug(webcam *camera, const char *options, char node[32]) {
    wait_without_node();
    int ends[2];
    check(pipe(ends) == 0, "pipe: %s", strerror(errno));
    *camera = (webcam){.log = ends[0]};
    fcntl(ends[0], F_SETFL, O_NONBLOCK);
    camera->pid = fork();
    if (camera->pid == 0) become_webcam(ends[1], options);
    close(ends[1]);
    check(camera->pid > 0, "fork: %s", strerror(errno));
    find_node(WEBCAM_NAME, node);
}

int webcam_said(webcam *camera, const char *text) {
    for (int i = 0; i < 40; i++) {
        size_t length = strlen(camera->said);
        ssize_t got = read(camera->log, camera->said + length, sizeof camera->said - 1 - length);
        if (got > 0) camera->said[length + (size_t)got] = 0;
        if (strstr(camera->said, text)) return 1;
        sleep_ms(50);
    }
    return 0;
}

void webcam_unplug(webcam *camera) {
    kill(camera->pid, SIGTERM);
    waitpid(camera->pid, NULL, 0);
    close(camera->log);
    wait_without_node();
}
