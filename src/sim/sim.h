/* sim.h - a simulated camera that is carried around a simulated scene: "sim:studio?option=value&...".
 *
 * Parts that know nothing of each other: the scene (studio.h, exact; baked.h, fast), the camera's path
 * (sim.c, walk.h), and the sensor (sensor.h). frames.c draws frames with them and plays the faults.
 */
#ifndef SF_SIM_SIM_H
#define SF_SIM_SIM_H

#include "../base/context.h"
#include "studio.h"
#include "walk.h"

/* From..to seconds after the first frame; both -1: never. */
typedef struct sf_sim_span {
    double from, to;
} sf_sim_span;

static inline int sf_span_holds(sf_sim_span span, double seconds) {
    return seconds >= span.from && seconds < span.to;
}

typedef struct sf_sim {
    sf_studio studio;
    int has_board; /* "sim:studio-board": the world is the board's frame, in metres */
    int walks;     /* the path is that of `walk`, in its time: all scenes but "sim:studio" */
    sf_board_place board;
    sf_walk walk;          /* where walks */
    int32_t width, height; /* px */
    uint64_t frames, seed;
    double fps;      /* in real time; 0: not */
    int loop;        /* goes round and round */
    double rounds;   /* of the path, where it does not */
    double fov;      /* degrees, across the width */
    double phase[6]; /* of the hand's sway, from the seed */
    int exact;       /* drawn by the ray caster, not from baked surfaces */
    int sensor;      /* frames tell their exposure */
    int blur, auto_exposure;
    double noise, jitter_s;
    sf_sim_span black, smear, unplug, mover, away, wall, spin;
    double mover_part; /* of the picture that the mover covers */
    double jump_s;     /* -1: never */
} sf_sim;

/* Reads the name of a simulated source; README.md lists the options. SF_ERR_ARGUMENT: unknown scene or
 * option, value out of range. */
sf_status sf_sim_init(sf_context *ctx, const char *name, sf_sim *sim);

/* The name of the same simulation as a project: frames that wait and end, without what a sensor adds. sf_free
 * it. */
sf_status sf_sim_project_name(sf_context *ctx, const char *name, char **project);

/* Seconds between two frames. */
double sf_sim_period(const sf_sim *sim);
/* Frames of all rounds. */
uint64_t sf_sim_frame_count(const sf_sim *sim);

/* The camera of frame 0 .. frames-1 in the source's world. sim:studio: once around a loop in front of the
 * scene's middle, 200 degrees wide, low on the way out to the right and back from the left, high in between,
 * with a hand's sway. Others: a walk (walk.h). */
void sf_sim_camera(const sf_sim *sim, uint64_t frame, sf_camera *camera);

/* The same in the studio's world, also between frames. */
void sf_sim_studio_camera(const sf_sim *sim, double frame, sf_camera *camera);

/* A camera of the studio's world in the source's, and back. */
void sf_sim_to_world(const sf_sim *sim, const sf_camera *studio, sf_camera *world);
void sf_sim_to_studio(const sf_sim *sim, const sf_camera *world, sf_camera *studio);

/* What a camera of the source's world sees at a picture position, in world units. */
void sf_sim_look(const sf_sim *sim, const sf_camera *camera, double x_px, double y_px, sf_vec3 *point,
                 double *distance);

#endif
