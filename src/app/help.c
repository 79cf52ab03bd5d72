/* help.c - what the tables of the commands say: for people, for the manual, for a shell that completes. */
#include <ctype.h>
#include <stdio.h>
#include <string.h>

#include <splatfit/splatfit.h>

#include "args.h"

/* An option of a table, or a hyperparameter. */
typedef struct shown {
    char name[64]; /* with dashes inside */
    char letter;
    const char *metavar; /* NULL: takes no value */
    const char *text;
    char note[128]; /* default and range of a hyperparameter */
} shown;

typedef void (*show_fn)(const shown *option);

static shown shown_option(const arg_option *o) {
    shown s = {.letter = o->letter, .metavar = o->metavar, .text = o->text};
    snprintf(s.name, sizeof s.name, "%s", o->name);
    return s;
}

/* Names are shown with dashes. */
static shown shown_hyperparameter(const sf_fit_options *defaults, const sf_option_info *info) {
    shown s = {.metavar = info->kind == SF_KIND_FLAG   ? NULL
                          : info->kind == SF_KIND_ENUM ? info->unit
                                                       : "X",
               .text = info->text};
    char value[64] = "";
    snprintf(s.name, sizeof s.name, "%s", info->name);
    for (char *c = s.name; *c; c++)
        if (*c == '_') *c = '-';
    sf_fit_options_get(defaults, info->name, value, sizeof value);
    if (info->kind == SF_KIND_ENUM)
        snprintf(s.note, sizeof s.note, " (%s)", value);
    else if (info->kind != SF_KIND_FLAG)
        snprintf(s.note, sizeof s.note, " (%s%s%s; %g..%g)", value, *info->unit ? " " : "", info->unit,
                 info->least, info->most);
    return s;
}

static void each_option(const command *cmd, show_fn show) {
    for (const arg_option *const *table = cmd->tables; *table; table++)
        for (const arg_option *o = *table; o->name; o++) {
            shown s = shown_option(o);
            show(&s);
        }
}

static void each_hyperparameter(show_fn show) {
    sf_fit_options defaults = sf_fit_options_default();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        shown s = shown_hyperparameter(&defaults, &info);
        show(&s);
    }
}

int help_first(const char *summary) {
    const char *end = strstr(summary, ". ");
    size_t n = end ? (size_t)(end - summary) : strlen(summary);
    return (int)(n && summary[n - 1] == '.' ? n - 1 : n);
}

/* For people */

static void print_option(const shown *s) {
    char name[128];
    int n =
        snprintf(name, sizeof name, "--%s%s%s", s->name, s->metavar ? " " : "", s->metavar ? s->metavar : "");
    printf("  %-28s%s%s%s", name, n > 27 ? "\n                              " : "", s->text, s->note);
    if (s->letter) printf(" (also -%c)", s->letter);
    printf("\n");
}

void help_text(const command *cmd) {
    printf("splatfit %s %s\n\n%s\n\nOptions:\n", cmd->name, cmd->synopsis, cmd->summary);
    each_option(cmd, print_option);
    if (!cmd->with_fit_options) return;
    printf("\nHyperparameters (also with _ for -):\n");
    each_hyperparameter(print_option);
}

/* For the manual */

/* Text escaped for roff; no line begins with a dot. */
static void roff(const char *text) {
    for (; *text; text++) {
        if (*text == '-')
            printf("\\-");
        else if (*text == '\\')
            printf("\\e");
        else
            putchar(*text);
    }
}

/* Where a page's paragraphs begin with a word, it may be one of roff's. */
static void roff_line(const char *text) {
    printf("\\&");
    roff(text);
    printf("\n");
}

static void man_option(const shown *s) {
    printf(".TP\n");
    if (s->letter) printf("\\fB\\-%c\\fR, ", s->letter);
    printf("\\fB\\-\\-");
    roff(s->name);
    printf("\\fR");
    if (s->metavar) {
        printf(" \\fI");
        roff(s->metavar);
        printf("\\fR");
    }
    printf("\n\\&");
    roff(s->text);
    roff_line(s->note);
}

/* The first sentence, with a small letter. */
static void man_name(const char *summary) {
    char first[512];
    snprintf(first, sizeof first, "%.*s", help_first(summary), summary);
    first[0] = (char)tolower((unsigned char)first[0]);
    roff(first);
    printf("\n");
}

void help_man(const command *cmd) {
    printf(".TH \"SPLATFIT\\-");
    for (const char *c = cmd->name; *c; c++) putchar(toupper((unsigned char)*c));
    printf("\" 1 \"\" \"splatfit %s\" \"splatfit\"\n.SH NAME\nsplatfit\\-%s \\- ", sf_version(), cmd->name);
    man_name(cmd->summary);
    printf(".SH SYNOPSIS\n.B splatfit %s\n", cmd->name);
    roff_line(cmd->synopsis);
    printf(".SH DESCRIPTION\n");
    roff_line(cmd->summary);
    printf("@DESCRIPTION@\n.SH OPTIONS\n");
    each_option(cmd, man_option);
    if (!cmd->with_fit_options) return;
    printf(".SH HYPERPARAMETERS\nAlso with _ for \\-; in brackets default and range.\n");
    each_hyperparameter(man_option);
}

/* For a shell */

/* What a value is: words apart by |, FILE, DIR, or nothing that can be told. */
static void print_word(const shown *s) {
    sf_isa_info info;
    printf("--%s", s->name);
    if (s->metavar && !strcmp(s->name, "isa")) {
        for (size_t i = 0; !sf_isa_describe(i, &info); i++)
            if (info.usable) printf("%c%s", i ? '|' : ' ', info.name);
    } else if (s->metavar) {
        printf(" %s", s->metavar);
    }
    printf("\n");
    if (s->letter) printf("-%c%s%s\n", s->letter, s->metavar ? " " : "", s->metavar ? s->metavar : "");
}

void help_words(const command *cmd) {
    each_option(cmd, print_word);
    if (cmd->with_fit_options) each_hyperparameter(print_word);
}
