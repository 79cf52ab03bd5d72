/* webcam.h - plugs the simulated webcam of uvcsim.c in, and out. */
#ifndef WEBCAM_H
#define WEBCAM_H

#define WEBCAM_NAME "Simulated webcam"

typedef struct webcam {
    int pid, log; /* of the program; what it prints */
    char said[4096];
} webcam;

/* Starts the program with these options, separated by spaces, and waits for its node. */
void webcam_plug(webcam *camera, const char *options, char node[32]);
/* Whether it has printed `text`, waited for 2 s. */
int webcam_said(webcam *camera, const char *text);
/* Ends it, and waits until its node is gone. */
void webcam_unplug(webcam *camera);

#endif
