/* ffmpeg.c - see ffmpeg.h. Frames come as PGM or PPM, one after another: each says its size. */
#include "ffmpeg.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "../base/hd.h"
#include "../base/pool.h"
#include "paths.h"
#include "picture.h"

extern char **environ;

/* ---- programs ---- */

static void close_files(FILE **a, FILE **b) {
    if (*a) fclose(*a);
    if (*b) fclose(*b);
    *a = *b = NULL;
}

static void finish(pid_t pid) {
    while (waitpid(pid, NULL, 0) < 0 && errno == EINTR) {
    }
}

/* Runs a program, found by PATH, without input: *out reads what it prints, *errors keeps what it complains
 * of. Returns 0 or an errno. */
static int spawn(char *const *command, pid_t *pid, FILE **out, FILE **errors) {
    int ends[2];
    posix_spawn_file_actions_t actions;
    *out = NULL;
    *errors = tmpfile();
    if (!*errors) return errno;
    if (pipe(ends)) {
        int error = errno;
        close_files(out, errors);
        return error;
    }
    for (int i = 0; i < 2; i++) fcntl(ends[i], F_SETFD, FD_CLOEXEC);
    int error = posix_spawn_file_actions_init(&actions);
    if (!error) {
        error = posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
        if (!error) error = posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
        if (!error) error = posix_spawn_file_actions_adddup2(&actions, fileno(*errors), STDERR_FILENO);
        if (!error) error = posix_spawnp(pid, command[0], &actions, NULL, command, environ);
        posix_spawn_file_actions_destroy(&actions);
    }
    close(ends[1]);
    *out = error ? NULL : fdopen(ends[0], "rb");
    if (*out) return 0;
    close(ends[0]);
    close_files(out, errors);
    if (error) return error;
    finish(*pid); /* it ends when it writes: nobody reads */
    return ENOMEM;
}

static sf_status cannot_start(sf_context *ctx, const char *video, const char *program, int error) {
    if (error == ENOENT)
        return sf_fail(ctx, SF_ERR_IO,
                       "%s: is a video: %s, which reads it, is not installed: apt install ffmpeg", video,
                       program);
    return sf_fail(ctx, SF_ERR_IO, "%s: %s cannot be started: %s", video, program, strerror(error));
}

/* The first line of a file, which tells the cause, without the video's name before it and "[h264 @ 0x55...]
 * ". */
static void first_line(FILE *file, const char *video, char *line, size_t size) {
    char text[512];
    *line = 0;
    rewind(file);
    while (!*line && fgets(text, sizeof text, file)) {
        char *at = text, *end = *at == '[' ? strstr(at, "] ") : NULL;
        if (end) at = end + 2;
        if (!strncmp(at, "file:", 5)) at += 5;
        if (!strncmp(at, video, strlen(video)) && !strncmp(at + strlen(video), ": ", 2))
            at += strlen(video) + 2;
        at[strcspn(at, "\r\n")] = 0;
        for (char *c = at; *c; c++)
            if (iscntrl((unsigned char)*c)) *c = '?';
        snprintf(line, size, "%s", at);
    }
}

/* With "file:" before it, a path is no option and no address. sf_free it. */
static char *file_of(sf_context *ctx, const char *video) {
    char *text = sf_alloc(ctx, strlen(video) + 6, 1);
    if (text) sprintf(text, "file:%s", video);
    return text;
}

/* ---- ffprobe ---- */

/* Of the first packets ffprobe decodes the frames: the stream's field order alone is not reliable
 * (findings/ffprobe_field_order.sh). A packet may be one field, and the first ones may lack what they refer
 * to. */
#define FIRST_PACKETS "8"

/* Besides the facts, what they are made of. */
typedef struct probe {
    sf_film_facts *facts;
    double seconds;
    char field_order[8]; /* as ffprobe names it: tt, bb, tb, bt; "": none of these */
    int is_hevc;
    int frames, woven; /* of the first ones: how many, and how many say that they are interlaced */
    int is_top;        /* whether the first one says that its upper field is first */
} probe;

/* One line "name=value". */
static void take_fact(const char *line, probe *p) {
    sf_film_facts *facts = p->facts;
    char name[64], value[64];
    double n, d;
    if (sscanf(line, "%63[^=]=%63s", name, value) != 2) return;
    if (!strcmp(name, "width")) facts->width = atoi(value);
    if (!strcmp(name, "height")) facts->height = atoi(value);
    if (!strcmp(name, "codec_name")) p->is_hevc = !strcmp(value, "hevc");
    if (!strcmp(name, "color_space")) facts->has_matrix = strcmp(value, "unknown") != 0;
    if (!strcmp(name, "color_transfer"))
        facts->is_hdr = !strcmp(value, "smpte2084") || !strcmp(value, "arib-std-b67");
    if (!strcmp(name, "field_order") && strlen(value) == 2 && strspn(value, "tb") == 2)
        strcpy(p->field_order, value);
    if (!strcmp(name, "interlaced_frame")) p->frames++, p->woven += atoi(value) == 1;
    if (!strcmp(name, "top_field_first") && p->frames == 1) p->is_top = atoi(value) == 1;
    if (!strcmp(name, "nb_frames")) facts->frames = atof(value);
    if (!strcmp(name, "duration") && atof(value) > 0) p->seconds = atof(value);
    if (!strcmp(name, "avg_frame_rate") && sscanf(value, "%lf/%lf", &n, &d) == 2 && d > 0)
        facts->rate = n / d;
}

static int most_are_woven(const probe *p) { return 2 * p->woven > p->frames; }

/* A decoder of HEVC, where all interlaced video is coded field by field, gives each field as a picture, whose
 * flag says which field it is. Some encoders flag whole frames so: these have no field's rate, which is 50/s
 * or more. */
static void take_fields(const probe *p) {
    enum { FIELD_RATE = 40 };
    sf_film_facts *facts = p->facts;
    int is_flagged = most_are_woven(p);
    if (is_flagged)
        facts->first = !p->is_hevc ? SF_FIELD_FLAGGED : p->is_top ? SF_FIELD_TOP : SF_FIELD_BOTTOM;
    else if (*p->field_order)
        facts->first = p->field_order[1] == 't' ? SF_FIELD_TOP : SF_FIELD_BOTTOM;
    facts->has_fields = is_flagged && p->is_hevc && facts->rate > FIELD_RATE;
    if (facts->has_fields) facts->height *= 2, facts->rate /= 2, facts->frames /= 2;
}

static void take_facts(FILE *out, probe *p) {
    char line[256];
    sf_film_facts *facts = p->facts;
    while (fgets(line, sizeof line, out)) take_fact(line, p);
    if (!(facts->rate > 0 && facts->rate < 1e6)) facts->rate = 0;
    if (!(facts->frames > 0)) facts->frames = facts->rate * p->seconds;
    if (!(facts->frames > 0 && facts->frames < 1e9)) facts->frames = 0;
    take_fields(p);
}

/* What is done about fields, and who said that there are some. */
static void tell_fields(sf_context *ctx, const char *video, const probe *p) {
    char order[64] = "", frames[64] = "";
    if (p->facts->first == SF_FIELD_NONE) return;
    /* what ffprobe 5.1 calls the order of HEVC's fields has another meaning */
    if (*p->field_order && !(most_are_woven(p) && p->is_hevc))
        snprintf(order, sizeof order, "field order %s by its stream", p->field_order);
    if (most_are_woven(p))
        snprintf(frames, sizeof frames, "%s%d of its first %d %s say", *order ? ", and " : "as ", p->woven,
                 p->frames, p->facts->has_fields ? "pictures" : "frames");
    sf_log(ctx, SF_LOG_INFO, "%s: is interlaced (%s%s): %s", video, order, frames,
           p->facts->has_fields ? "each two of its pictures, which are fields, become one frame"
                                : "its frames are deinterlaced");
}

sf_status sf_ffmpeg_probe(sf_context *ctx, const char *video, sf_film_facts *facts) {
    pid_t pid;
    FILE *out, *errors;
    char fault[256];
    probe p = {.facts = facts};
    *facts = (sf_film_facts){0};
    if (!sf_is_file(video)) return sf_fail(ctx, SF_ERR_IO, "%s: there is no such file", video);
    char *file = file_of(ctx, video);
    if (!file) return SF_ERR_MEMORY;
    /* V: streams that are more than the picture of a cover */
    const char *command[] = {"ffprobe",
                             "-v",
                             "error",
                             "-select_streams",
                             "V:0",
                             "-show_entries",
                             "stream=codec_name,width,height,color_space,color_transfer,field_order,"
                             "nb_frames,duration,avg_frame_rate:format=duration:"
                             "frame=interlaced_frame,top_field_first",
                             "-read_intervals",
                             "%+#" FIRST_PACKETS,
                             "-of",
                             "default=noprint_wrappers=1",
                             "-i",
                             file,
                             NULL};
    int error = spawn((char *const *)(uintptr_t)command, &pid, &out, &errors);
    sf_free(ctx, file);
    if (error) return cannot_start(ctx, video, "ffprobe", error);
    take_facts(out, &p);
    finish(pid);
    first_line(errors, video, fault, sizeof fault);
    close_files(&out, &errors);
    if (facts->width > 0 && facts->height > 0) {
        tell_fields(ctx, video, &p);
        return SF_OK;
    }
    if (*fault) return sf_fail(ctx, SF_ERR_FORMAT, "%s: ffmpeg cannot read it: %s", video, fault);
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: holds no video stream", video);
}

/* ---- ffmpeg ---- */

int sf_ffmpeg_scale(const sf_film_facts *facts, int side, const char *how, char *text, size_t size) {
    /* auto: what the video says, else BT.601 */
    const char *matrix = facts->has_matrix || !sf_is_hd(facts->width, facts->height) ? "auto" : "bt709";
    return snprintf(text, size,
                    "scale=w='max(1,round(iw*sar*min(1,%d/max(iw*sar,ih))))':"
                    "h='max(1,round(ih*min(1,%d/max(iw*sar,ih))))':in_color_matrix=%s:flags=%s,setsar=1",
                    side, side, matrix, how);
}

/* Frames get times one after another, at the rate that they are asked for: otherwise ffmpeg would drop and
 * repeat frames of a video whose rate varies. */
enum { RATE = 30 };

/* One frame of each two fields, so that their numbers stay. Before all else: it compares neighbours. bwdif
 * takes frames that are not flagged for ones whose upper field is first. Returns the text's length. */
static int deinterlace(const sf_film_facts *facts, char *text, size_t size) {
    static const char *const parity[] = {
        [SF_FIELD_FLAGGED] = "auto", [SF_FIELD_TOP] = "tff", [SF_FIELD_BOTTOM] = "bff"};
    *text = 0;
    if (facts->first == SF_FIELD_NONE) return 0;
    const char *weave = !facts->has_fields                ? ""
                        : facts->first == SF_FIELD_BOTTOM ? "weave=first_field=bottom,"
                                                          : "weave=first_field=top,";
    return snprintf(text, size, "%sbwdif=mode=send_frame:parity=%s,", weave, parity[facts->first]);
}

sf_status sf_frame_pipe_open(sf_frame_pipe *p, sf_context *ctx, const char *video, const sf_film_facts *facts,
                             const char *filters, int channels) {
    enum { SPARE = 192 };
    char threads[16], rate[16];
    *p = (sf_frame_pipe){.ctx = ctx, .video = video, .channels = channels};
    size_t size = strlen(filters) + SPARE;
    char *file = file_of(ctx, video), *all = sf_alloc(ctx, size, 1);
    snprintf(threads, sizeof threads, "%d", sf_pool_threads(ctx->pool));
    snprintf(rate, sizeof rate, "%d", RATE);
    if (file && all) {
        int n = deinterlace(facts, all, size);
        snprintf(all + n, size - (size_t)n, "%s,settb=1/%d,setpts=N,format=%s", filters, RATE,
                 channels == 1 ? "gray" : "rgb24");
    }
    const char *command[] = {
        "ffmpeg", "-nostdin",   "-v",     "error", "-threads", threads, "-i",   file,
        "-map",   "0:V:0",      "-vf",    all,     "-r",       rate,    "-c:v", channels == 1 ? "pgm" : "ppm",
        "-f",     "image2pipe", "pipe:1", NULL};
    int error = file && all ? spawn((char *const *)(uintptr_t)command, &p->pid, &p->frames, &p->errors) : 0;
    int ready = file && all;
    sf_free(ctx, file);
    sf_free(ctx, all);
    if (!ready) return SF_ERR_MEMORY;
    return error ? cannot_start(ctx, video, "ffmpeg", error) : SF_OK;
}

sf_status sf_frame_pipe_next(sf_frame_pipe *p) {
    char kind;
    int most, read = fscanf(p->frames, "P%c %d %d %d", &kind, &p->width, &p->height, &most);
    p->is_over = read == EOF;
    if (p->is_over) return SF_ERR_END;
    if (read != 4 || kind != (p->channels == 1 ? '5' : '6') || most != 255 || fgetc(p->frames) == EOF ||
        p->width < 1 || p->height < 1 || p->width > SF_PICTURE_MAX_SIDE || p->height > SF_PICTURE_MAX_SIDE ||
        (int64_t)p->width * p->height > SF_PICTURE_MAX_PIXELS)
        return sf_fail(p->ctx, SF_ERR_FORMAT, "%s: what ffmpeg sends is no frame", p->video);
    size_t bytes = (size_t)p->width * (size_t)p->height * (size_t)p->channels;
    sf_status status = sf_grow(p->ctx, &p->pixels, &p->capacity, 0, bytes, 1);
    if (status) return status;
    p->is_over = fread(p->pixels, 1, bytes, p->frames) != bytes;
    return p->is_over ? SF_ERR_END : SF_OK;
}

void sf_frame_pipe_close(sf_frame_pipe *p, char *fault, size_t size) {
    *fault = 0;
    if (p->frames) {
        if (!p->is_over) kill(p->pid, SIGKILL); /* it may wait for a reader */
        finish(p->pid);
        first_line(p->errors, p->video, fault, size);
        close_files(&p->frames, &p->errors);
    }
    sf_free(p->ctx, p->pixels);
    p->pixels = NULL;
}
