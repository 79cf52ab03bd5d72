/* v4l2_controls.c - exposure, gain, white balance, focus and every other control of a V4L2 node. */
#ifdef __linux__
#include "v4l2_device.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_CONTROLS = 512 }; /* that are looked through */

/* What the camera sets by itself where it is allowed to. Menus may lack an entry: then the second counts. */
typedef struct automatic {
    const char *option;
    uint32_t chooser; /* the control that says who chooses */
    int32_t camera[2], user[2];
    uint32_t value[2]; /* the control of the value, or what some cameras have in its place; 0: nothing */
    const char *chooser_name, *value_name;
} automatic;

static const automatic exposure_control = {"exposure",
                                           V4L2_CID_EXPOSURE_AUTO,
                                           {V4L2_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY},
                                           {V4L2_EXPOSURE_MANUAL, V4L2_EXPOSURE_SHUTTER_PRIORITY},
                                           {V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE},
                                           "Auto Exposure",
                                           "Exposure Time, Absolute"};
static const automatic gain_control = {
    "gain", V4L2_CID_AUTOGAIN, {1, 1}, {0, 0}, {V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN}, "Gain, Automatic",
    "Gain"};
static const automatic white_control = {"white_balance",
                                        V4L2_CID_AUTO_WHITE_BALANCE,
                                        {1, 1},
                                        {0, 0},
                                        {V4L2_CID_WHITE_BALANCE_TEMPERATURE, 0},
                                        "White Balance, Automatic",
                                        "White Balance Temperature"};
static const automatic focus_control = {
    "focus",          V4L2_CID_FOCUS_AUTO,          {1, 1},
    {0, 0},           {V4L2_CID_FOCUS_ABSOLUTE, 0}, "Focus, Automatic Continuous",
    "Focus, Absolute"};

/* Finds a control, or with V4L2_CTRL_FLAG_NEXT_CTRL the one after it. 0: there is none. */
static int query(sf_v4l2_device *device, uint32_t id, struct v4l2_queryctrl *q) {
    memset(q, 0, sizeof *q);
    q->id = id;
    if (!id || sf_v4l2_ioctl(device, VIDIOC_QUERYCTRL, q)) return 0;
    return id & V4L2_CTRL_FLAG_NEXT_CTRL || !(q->flags & V4L2_CTRL_FLAG_DISABLED);
}

static int is_shown(const struct v4l2_queryctrl *q) {
    return q->type != V4L2_CTRL_TYPE_CTRL_CLASS && !(q->flags & V4L2_CTRL_FLAG_DISABLED);
}

static sf_status refuse_control(sf_v4l2_device *device, const char *option, const char *name) {
    char text[512] = "";
    size_t length = 0;
    struct v4l2_queryctrl q;
    uint32_t id = 0;
    for (int i = 0; i < MOST_CONTROLS && query(device, id | V4L2_CTRL_FLAG_NEXT_CTRL, &q); i++) {
        id = q.id;
        if (!is_shown(&q)) continue;
        int n = snprintf(text + length, sizeof text - length, "%s\"%.32s\"", length ? ", " : "",
                         (const char *)q.name);
        if (n < 0 || (size_t)n >= sizeof text - length) {
            text[length] = 0;
            break;
        }
        length += (size_t)n;
    }
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: %s: the camera has no control \"%s\"; it has: %s",
                   device->path, option, name, length ? text : "none");
}

static int has_entry(sf_v4l2_device *device, const struct v4l2_queryctrl *q, int64_t value) {
    struct v4l2_querymenu entry = {.id = q->id, .index = (uint32_t)value};
    if (value < q->minimum || value > q->maximum) return 0;
    if (q->type != V4L2_CTRL_TYPE_MENU && q->type != V4L2_CTRL_TYPE_INTEGER_MENU) return 1;
    return sf_v4l2_ioctl(device, VIDIOC_QUERYMENU, &entry) == 0;
}

static sf_status set(sf_v4l2_device *device, const char *option, const struct v4l2_queryctrl *q,
                     int64_t value) {
    switch (q->type) {
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_BOOLEAN:
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
    case V4L2_CTRL_TYPE_BITMASK:
        if (has_entry(device, q, value)) break;
        return sf_fail(device->ctx, SF_ERR_ARGUMENT, "%s: %s: %lld: \"%.32s\" is from %d to %d", device->path,
                       option, (long long)value, (const char *)q->name, (int)q->minimum, (int)q->maximum);
    case V4L2_CTRL_TYPE_BUTTON:
        break; /* any value presses it */
    default:
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: %s: \"%.32s\" is no number that can be set",
                       device->path, option, (const char *)q->name);
    }
    struct v4l2_control c = {.id = q->id, .value = (int32_t)value};
    if (sf_v4l2_ioctl_again(device, VIDIOC_S_CTRL, &c) == 0) return SF_OK;
    char what[128];
    snprintf(what, sizeof what, "%s: \"%.32s\" cannot be set to %lld", option, (const char *)q->name,
             (long long)value);
    return sf_v4l2_fail(device, what);
}

/* Names are compared by their letters and digits alone. */
static int same_name(const char *a, size_t a_length, const char *b, size_t b_length) {
    size_t i = 0, j = 0;
    for (;; i++, j++) {
        while (i < a_length && !isalnum((unsigned char)a[i])) i++;
        while (j < b_length && !isalnum((unsigned char)b[j])) j++;
        if (i == a_length || j == b_length) return i == a_length && j == b_length;
        if (tolower((unsigned char)a[i]) != tolower((unsigned char)b[j])) return 0;
    }
}

static size_t name_length(const void *name) {
    const char *end = memchr(name, 0, 32);
    return end ? (size_t)(end - (const char *)name) : 32;
}

static int parse_whole(const char *text, size_t length, int64_t *value) {
    char copy[24], *end;
    if (length == 0 || length >= sizeof copy || strspn(text, "-0123456789") < length) return 0;
    memcpy(copy, text, length);
    copy[length] = 0;
    errno = 0;
    *value = strtoll(copy, &end, 10);
    return *end == 0 && errno == 0;
}

/* ---- the four that have options of their own ---- */

static int find_value(sf_v4l2_device *device, const automatic *a, struct v4l2_queryctrl *q) {
    return query(device, a->value[0], q) || query(device, a->value[1], q);
}

static sf_status let_choose(sf_v4l2_device *device, const automatic *a, const struct v4l2_queryctrl *chooser,
                            const int32_t values[2]) {
    int second = !has_entry(device, chooser, values[0]) && has_entry(device, chooser, values[1]);
    return set(device, a->option, chooser, values[second]);
}

static sf_status set_automatic(sf_v4l2_device *device, const automatic *a, const char *text) {
    struct v4l2_queryctrl chooser, value;
    int64_t number;
    if (!*text) return SF_OK;
    int has_chooser = query(device, a->chooser, &chooser);
    if (strcmp(text, "auto") == 0) {
        if (!has_chooser) return refuse_control(device, a->option, a->chooser_name);
        return let_choose(device, a, &chooser, a->camera);
    }
    if (strncmp(text, "manual:", strlen("manual:")) == 0) text += strlen("manual:");
    if (!parse_whole(text, strlen(text), &number))
        return sf_fail(device->ctx, SF_ERR_ARGUMENT, "%s: %s: \"%s\" is neither auto nor a whole number",
                       device->path, a->option, text);
    if (!find_value(device, a, &value)) return refuse_control(device, a->option, a->value_name);
    sf_status status = has_chooser ? let_choose(device, a, &chooser, a->user) : SF_OK;
    return status == SF_OK ? set(device, a->option, &value, number) : status;
}

/* The value, where the user has chosen it. 0: not known. */
static double read_chosen(sf_v4l2_device *device, const automatic *a, uint32_t id) {
    struct v4l2_queryctrl q;
    struct v4l2_control chooser = {.id = a->chooser}, value = {.id = id};
    if (!query(device, id, &q) || sf_v4l2_ioctl(device, VIDIOC_G_CTRL, &value)) return 0;
    if (query(device, a->chooser, &q) && sf_v4l2_ioctl(device, VIDIOC_G_CTRL, &chooser) == 0 &&
        chooser.value != a->user[0] && chooser.value != a->user[1])
        return 0;
    return value.value;
}

/* ---- all others, by name ---- */

static int find_by_name(sf_v4l2_device *device, const char *name, size_t length, struct v4l2_queryctrl *q) {
    uint32_t id = 0;
    for (int i = 0; i < MOST_CONTROLS && query(device, id | V4L2_CTRL_FLAG_NEXT_CTRL, q); i++) {
        id = q->id;
        if (is_shown(q) && same_name(name, length, (const char *)q->name, name_length(q->name))) return 1;
    }
    return 0;
}

/* A number, or the name of an entry of a menu. */
static int parse_value(sf_v4l2_device *device, const struct v4l2_queryctrl *q, const char *text,
                       size_t length, int64_t *value) {
    if (parse_whole(text, length, value)) return 1;
    if (q->type != V4L2_CTRL_TYPE_MENU) return 0;
    for (int64_t i = q->minimum; i <= q->maximum && i < MOST_CONTROLS; i++) {
        struct v4l2_querymenu entry = {.id = q->id, .index = (uint32_t)i};
        if (sf_v4l2_ioctl(device, VIDIOC_QUERYMENU, &entry)) continue;
        *value = i;
        if (same_name(text, length, (const char *)entry.name, name_length(entry.name))) return 1;
    }
    return 0;
}

/* "NAME=VALUE", which ends at `end`. */
static sf_status set_by_name(sf_v4l2_device *device, const char *text, const char *end) {
    char option[64], name[48];
    struct v4l2_queryctrl q;
    int64_t number;
    size_t length = strcspn(text, "=&");
    const char *value = text + length + (text[length] == '=');
    snprintf(name, sizeof name, "%.*s", (int)(length < 40 ? length : 40), text);
    snprintf(option, sizeof option, "ctrl.%s", name);
    if (!find_by_name(device, text, length, &q)) return refuse_control(device, option, name);
    if (!parse_value(device, &q, value, (size_t)(end - value), &number))
        return sf_fail(device->ctx, SF_ERR_ARGUMENT,
                       "%s: %s: \"%.*s\" is neither a whole number nor in the menu", device->path, option,
                       (int)(end - value), value);
    return set(device, option, &q, number);
}

sf_status sf_v4l2_set_controls(sf_v4l2_device *device, const sf_v4l2_settings *settings, double *exposure_s,
                               double *gain) {
    sf_status status = set_automatic(device, &exposure_control, settings->exposure);
    if (status == SF_OK) status = set_automatic(device, &gain_control, settings->gain);
    if (status == SF_OK) status = set_automatic(device, &white_control, settings->white_balance);
    if (status == SF_OK) status = set_automatic(device, &focus_control, settings->focus);
    const char *text = strchr(settings->options, '?');
    while (status == SF_OK && text && *text) {
        text++; /* over ? or & */
        const char *end = text + strcspn(text, "&");
        if (strncmp(text, "ctrl.", strlen("ctrl.")) == 0)
            status = set_by_name(device, text + strlen("ctrl."), end);
        text = end;
    }
    *exposure_s = 1e-4 * read_chosen(device, &exposure_control, V4L2_CID_EXPOSURE_ABSOLUTE);
    *gain = read_chosen(device, &gain_control, V4L2_CID_GAIN);
    if (*gain == 0) *gain = read_chosen(device, &gain_control, V4L2_CID_ANALOGUE_GAIN);
    return status;
}

/* ---- locked on the way ---- */

static const automatic *const lockable[] = {&exposure_control, &gain_control, &white_control};
enum { LOCKABLE = sizeof lockable / sizeof *lockable };

int sf_v4l2_has_automatic(sf_v4l2_device *device) {
    struct v4l2_queryctrl q;
    for (int i = 0; i < LOCKABLE; i++)
        if (query(device, lockable[i]->chooser, &q)) return 1;
    return 0;
}

sf_status sf_v4l2_lock(sf_v4l2_device *device, int locked, unsigned *were) {
    sf_status status = SF_OK;
    for (int i = 0; i < LOCKABLE && !status; i++) {
        const automatic *a = lockable[i];
        struct v4l2_queryctrl q;
        struct v4l2_control chooser = {.id = a->chooser};
        if (!query(device, a->chooser, &q) || sf_v4l2_ioctl(device, VIDIOC_G_CTRL, &chooser)) continue;
        int automatic_now = chooser.value != a->user[0] && chooser.value != a->user[1];
        if (locked && automatic_now) {
            status = let_choose(device, a, &q, a->user);
            *were |= 1u << i;
        }
        if (!locked && *were >> i & 1) status = let_choose(device, a, &q, a->camera);
    }
    if (!locked) *were = 0;
    return status;
}
#endif
