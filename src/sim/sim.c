/* sim.c - a simulated camera that is carried around a simulated scene: its name, and its path. */
#include "sim.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/query.h"
#include "../base/rng.h"

static const double pi = 3.141592653589793;

/* 1. The name */

typedef enum scene { STUDIO, WITH_BOARD, CORRIDOR, SCENES } scene;
static const char *const scenes[SCENES] = {"sim:studio", "sim:studio-board", "sim:corridor"};

/* Which scene a name begins with; SCENES: none. */
static scene which_scene(const char *name) {
    size_t length = strcspn(name, "?");
    scene which = STUDIO;
    while (which < SCENES && (length != strlen(scenes[which]) || memcmp(name, scenes[which], length) != 0))
        which++;
    return which;
}

enum { SPAN_TEXT = 40 };

/* Reads "A:B", seconds; "" is never. */
static sf_status read_span(sf_context *ctx, const char *name, const char *option, const char *text,
                           sf_sim_span *span) {
    char *colon, *end;
    *span = (sf_sim_span){-1, -1};
    if (!*text) return SF_OK;
    if (strspn(text, "0123456789.:") == strlen(text)) {
        span->from = strtod(text, &colon);
        span->to = *colon == ':' ? strtod(colon + 1, &end) : -1;
        if (*colon == ':' && colon > text && end > colon + 1 && !*end && span->to > span->from) return SF_OK;
    }
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%s\" is not A:B, two times in seconds, the second later",
                   name, option, text);
}

/* "1" is always, "0" never. */
static sf_status read_mover(sf_context *ctx, const char *name, const char *text, sf_sim_span *span) {
    if (!strcmp(text, "0")) text = "";
    if (strcmp(text, "1") != 0) return read_span(ctx, name, "mover", text, span);
    *span = (sf_sim_span){0, INFINITY};
    return SF_OK;
}

static sf_status read_exposure(sf_context *ctx, const char *name, const char *text, int *automatic) {
    *automatic = strcmp(text, "auto") == 0;
    if (*automatic || strcmp(text, "fixed") == 0) return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: exposure: \"%s\" is neither auto nor fixed", name, text);
}

static void furnish(sf_sim *sim, scene which) {
    sf_rng rng;
    sf_rng_seed(&rng, sim->seed);
    for (int i = 0; i < 6; i++) sim->phase[i] = 2 * pi * sf_rng_uniform(&rng);
    sf_walk_init(&sim->walk, which == CORRIDOR ? SF_WALK_CORRIDOR : SF_WALK_TABLE, sim->seed);
    if (which == WITH_BOARD)
        sf_studio_init_board(&sim->studio, &sim->board);
    else if (which == CORRIDOR)
        sf_studio_init_corridor(&sim->studio);
    else
        sf_studio_init(&sim->studio);
}

/* Takes away what a sensor adds, and all faults. */
static void clean(sf_sim *sim) {
    const sf_sim_span never = {-1, -1};
    sim->sensor = sim->blur = sim->auto_exposure = 0;
    sim->noise = sim->jitter_s = 0;
    sim->black = sim->smear = sim->unplug = sim->mover = sim->away = never;
    sim->wall = sim->spin = never;
    sim->jump_s = -1;
}

enum {
    WIDTH,
    HEIGHT,
    FRAMES,
    SEED,
    FOV,
    FPS,
    LOOP,
    ROUNDS,
    EXACT,
    CLEAN,
    NOISE,
    BLUR,
    EXPOSURE,
    JITTER,
    BLACK,
    SMEAR,
    UNPLUG,
    AWAY,
    JUMP,
    MOVER,
    MOVER_PART,
    WALL,
    SPIN,
    OPTIONS
};

/* What options are texts. */
typedef struct texts {
    char exposure[8], black[SPAN_TEXT], smear[SPAN_TEXT], unplug[SPAN_TEXT], mover[SPAN_TEXT],
        away[SPAN_TEXT], wall[SPAN_TEXT], spin[SPAN_TEXT];
} texts;

static void take_numbers(const sf_query_option options[OPTIONS], sf_sim *sim) {
    sim->width = (int32_t)options[WIDTH].value;
    sim->height = (int32_t)options[HEIGHT].value;
    sim->frames = (uint64_t)options[FRAMES].value;
    sim->seed = (uint64_t)options[SEED].value;
    sim->fov = options[FOV].value;
    sim->fps = options[FPS].value;
    sim->loop = options[LOOP].value != 0;
    sim->rounds = options[ROUNDS].value;
    sim->exact = options[EXACT].value != 0;
    sim->noise = options[NOISE].value;
    sim->blur = options[BLUR].value != 0;
    sim->jitter_s = options[JITTER].value * 1e-3;
    sim->jump_s = options[JUMP].value;
    sim->mover_part = options[MOVER_PART].value;
    sim->sensor = sim->walks || sim->blur || sim->auto_exposure || sim->noise > 0;
}

static sf_status take_texts(sf_context *ctx, const char *name, const texts *text, sf_sim *sim) {
    sf_status status = read_exposure(ctx, name, text->exposure, &sim->auto_exposure);
    if (status == SF_OK) status = read_span(ctx, name, "black", text->black, &sim->black);
    if (status == SF_OK) status = read_span(ctx, name, "smear", text->smear, &sim->smear);
    if (status == SF_OK) status = read_span(ctx, name, "unplug", text->unplug, &sim->unplug);
    if (status == SF_OK) status = read_span(ctx, name, "away", text->away, &sim->away);
    if (status == SF_OK) status = read_span(ctx, name, "wall", text->wall, &sim->wall);
    if (status == SF_OK) status = read_span(ctx, name, "spin", text->spin, &sim->spin);
    return status == SF_OK ? read_mover(ctx, name, text->mover, &sim->mover) : status;
}

/* Of a walk the live source's values are the defaults: sf_sim_project_name has those of a project. */
static sf_status read_name(sf_context *ctx, const char *name, scene which, sf_sim *sim) {
    int walks = which != STUDIO;
    texts text = {.exposure = "fixed"};
    if (walks) snprintf(text.exposure, sizeof text.exposure, "auto");
    sf_query_option options[OPTIONS] = {
        [WIDTH] = {.name = "width", .value = 320, .least = 16, .most = 4096, .whole = 1},
        [HEIGHT] = {.name = "height", .value = 240, .least = 16, .most = 4096, .whole = 1},
        [FRAMES] = {.name = "frames", .value = walks ? 1800 : 60, .least = 1, .most = 10000, .whole = 1},
        [SEED] = {.name = "seed", .value = 1, .most = 0x1p53, .whole = 1},
        [FOV] = {.name = "fov", .value = which == CORRIDOR ? 65 : 50, .least = 10, .most = 120},
        [FPS] = {.name = "fps", .value = walks ? 30 : 0, .most = 1000},
        [LOOP] = {.name = "loop", .most = 1, .whole = 1},
        [ROUNDS] = {.name = "rounds", .value = 1, .least = 0.001, .most = 1000},
        [EXACT] = {.name = "exact", .value = !walks, .most = 1, .whole = 1},
        [CLEAN] = {.name = "clean", .most = 1, .whole = 1},
        [NOISE] = {.name = "noise", .value = walks, .most = 10},
        [BLUR] = {.name = "blur", .value = walks, .most = 1, .whole = 1},
        [EXPOSURE] = {.name = "exposure", .text = text.exposure, .text_size = sizeof text.exposure},
        [JITTER] = {.name = "jitter", .value = walks ? 20 : 0, .most = 1000},
        [BLACK] = {.name = "black", .text = text.black, .text_size = sizeof text.black},
        [SMEAR] = {.name = "smear", .text = text.smear, .text_size = sizeof text.smear},
        [UNPLUG] = {.name = "unplug", .text = text.unplug, .text_size = sizeof text.unplug},
        [AWAY] = {.name = "away", .text = text.away, .text_size = sizeof text.away},
        [JUMP] = {.name = "jump", .value = -1, .most = 1e6},
        [MOVER] = {.name = "mover", .text = text.mover, .text_size = sizeof text.mover},
        [MOVER_PART] = {.name = "mover_part", .value = 0.1, .least = 0.01, .most = 0.7},
        [WALL] = {.name = "wall", .text = text.wall, .text_size = sizeof text.wall},
        [SPIN] = {.name = "spin", .text = text.spin, .text_size = sizeof text.spin},
    };
    sf_status status = sf_query_parse(ctx, name, options, OPTIONS);
    if (status == SF_OK) status = take_texts(ctx, name, &text, sim);
    if (status != SF_OK) return status;
    take_numbers(options, sim);
    if (options[CLEAN].value != 0) clean(sim);
    return SF_OK;
}

sf_status sf_sim_init(sf_context *ctx, const char *name, sf_sim *sim) {
    scene which = which_scene(name);
    memset(sim, 0, sizeof *sim);
    if (which == SCENES)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown simulated scene; known: %s, %s, %s", name,
                       scenes[STUDIO], scenes[WITH_BOARD], scenes[CORRIDOR]);
    sim->has_board = which == WITH_BOARD;
    sim->walks = which != STUDIO;
    sf_status status = read_name(ctx, name, which, sim);
    if (status == SF_OK) furnish(sim, which);
    return status;
}

sf_status sf_sim_project_name(sf_context *ctx, const char *name, char **project) {
    /* The last of two options of one name counts. */
    static const char before[] = "?frames=120&fps=0&exact=1", after[] = "&clean=1";
    size_t size = strlen(name) + sizeof before + sizeof after, length = strcspn(name, "?");
    if (!(*project = sf_alloc(ctx, size, 1))) return SF_ERR_MEMORY;
    scene which = which_scene(name);
    if (which == WITH_BOARD || which == CORRIDOR)
        snprintf(*project, size, "%.*s%s%s%s%s", (int)length, name, before, name[length] ? "&" : "",
                 name + length + (name[length] != 0), after);
    else
        snprintf(*project, size, "%s", name);
    return SF_OK;
}

/* 2. The path */

/* One of six wobbles of size 1 that close with the loop. */
static double sway(const sf_sim *sim, int which, double turn) {
    return sin((3 + which) * turn + sim->phase[which]);
}

static void circle_pose(const sf_sim *sim, double turn, sf_camera *camera) {
    const double degree = pi / 180;
    double azimuth = 100 * degree * sin(turn) + 0.02 * sway(sim, 0, turn);
    double elevation = (25 - 12 * cos(turn)) * degree + 0.02 * sway(sim, 1, turn);
    double radius = 4.3 + 0.08 * sway(sim, 2, turn);
    sf_vec3 middle = {0.03 * sway(sim, 3, turn), 0.03 * sway(sim, 4, turn), 0.78};
    sf_vec3 offset = {sin(azimuth) * cos(elevation), -cos(azimuth) * cos(elevation), sin(elevation)};
    sf_camera_aim(camera, vat(middle, radius, offset), middle, 0.015 * sway(sim, 5, turn));
}

double sf_sim_period(const sf_sim *sim) {
    if (sim->fps > 0) return 1 / sim->fps;
    return sim->walks ? (double)SF_WALK_SECONDS / (double)sim->frames : 1.0 / 30;
}

uint64_t sf_sim_frame_count(const sf_sim *sim) {
    return (uint64_t)fmax(round(sim->rounds * (double)sim->frames), 1);
}

void sf_sim_studio_camera(const sf_sim *sim, double frame, sf_camera *camera) {
    double focal = sim->width / 2.0 / tan(sim->fov / 2 * (pi / 180));
    *camera = (sf_camera){.width = sim->width,
                          .height = sim->height,
                          .fx = focal,
                          .fy = focal,
                          .cx = sim->width / 2.0,
                          .cy = sim->height / 2.0};
    if (sim->walks)
        sf_walk_pose(&sim->walk, SF_WALK_SECONDS * frame / (double)sim->frames, camera);
    else
        circle_pose(sim, 2 * pi * frame / (double)sim->frames, camera);
}

void sf_sim_camera(const sf_sim *sim, uint64_t frame, sf_camera *camera) {
    sf_camera studio;
    sf_sim_studio_camera(sim, (double)frame, &studio);
    sf_sim_to_world(sim, &studio, camera);
}

/* 3. The world: with a board it is p_b, where p_studio = origin + R_wb p_b / unit_m. */

void sf_sim_to_world(const sf_sim *sim, const sf_camera *studio, sf_camera *world) {
    *world = *studio;
    if (!sim->has_board) return;
    const sf_board_place *b = &sim->board;
    const double origin[3] = {b->origin.x, b->origin.y, b->origin.z};
    double t[3];
    sf_mat3_mul(studio->R_cw, b->R_wb, world->R_cw);
    sf_mat3_vec(studio->R_cw, origin, t);
    for (int i = 0; i < 3; i++) world->t_cw[i] = b->unit_m * (t[i] + studio->t_cw[i]);
}

void sf_sim_to_studio(const sf_sim *sim, const sf_camera *world, sf_camera *studio) {
    *studio = *world;
    if (!sim->has_board) return;
    const sf_board_place *b = &sim->board;
    const double origin[3] = {b->origin.x, b->origin.y, b->origin.z};
    double t[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) studio->R_cw[3 * i + j] = sf_dot3(&world->R_cw[3 * i], &b->R_wb[3 * j]);
    sf_mat3_vec(studio->R_cw, origin, t);
    for (int i = 0; i < 3; i++) studio->t_cw[i] = world->t_cw[i] / b->unit_m - t[i];
}

void sf_sim_look(const sf_sim *sim, const sf_camera *camera, double x_px, double y_px, sf_vec3 *point,
                 double *distance) {
    sf_camera studio;
    sf_hit hit;
    sf_sim_to_studio(sim, camera, &studio);
    sf_studio_look(&sim->studio, &studio, x_px, y_px, &hit);
    *point = hit.point;
    *distance = hit.distance;
    if (!sim->has_board) return;
    const sf_board_place *b = &sim->board;
    sf_vec3 off = vscale(vsub(hit.point, b->origin), b->unit_m);
    const double *R = b->R_wb;
    *point = vec3(R[0] * off.x + R[3] * off.y + R[6] * off.z, R[1] * off.x + R[4] * off.y + R[7] * off.z,
                  R[2] * off.x + R[5] * off.y + R[8] * off.z);
    *distance = b->unit_m * hit.distance;
}
