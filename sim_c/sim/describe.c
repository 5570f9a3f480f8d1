/* Descriptors of the effects as JSON, a writer for each kind of value of effects/descriptor.h. */
#define GES_W 1
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../effects/effect.h"
#include "effects_known.h"

/* What stands between two members of a list or an object: nothing before the first. */
static const char *member(FILE *f, const char *between) {
  fputs(between, f);
  return ", ";
}

static void write_characters(FILE *f, const char *text, size_t n) {
  fputc('"', f);
  for (size_t i = 0; i < n; i++) {
    if (text[i] == '"' || text[i] == '\\') fputc('\\', f);
    fputc(text[i], f);
  }
  fputc('"', f);
}

static void write_text(FILE *f, ges_text text) { write_characters(f, text ? text : "", text ? strlen(text) : 0); }

static void write_words(FILE *f, ges_words words) {
  const char *between = "";
  fputc('[', f);
  for (const char *word = words ? words : ""; *(word += strspn(word, " ")); word += strcspn(word, " ")) {
    between = member(f, between);
    write_characters(f, word, strcspn(word, " "));
  }
  fputc(']', f);
}

static void write_number(FILE *f, double value) {
  if (isnan(value)) fputs("NaN", f);
  else if (isinf(value)) fputs(value > 0.0 ? "Infinity" : "-Infinity", f);
  else fprintf(f, value == floor(value) && fabs(value) < 1e15 ? "%.1f" : "%.17g", value); /* 1.0, not 1: a number with a point */
}

static void write_whole(FILE *f, int value) { fprintf(f, "%d", value); }
static void write_flag(FILE *f, int value) { fputs(value ? "true" : "false", f); }

#define NAME(constant, name) [constant] = name,
#define CHOICE(kind, CHOICES)                                                                                           \
  static void write_##kind(FILE *f, int choice) {                                                                       \
    static const char *const names[] = {CHOICES(NAME)};                                                                 \
    write_text(f, choice > 0 && choice < (int)(sizeof names / sizeof *names) ? names[choice] : NULL);                   \
  }
CHOICE(kind, GES_KINDS)
CHOICE(about, GES_ABOUTS)
CHOICE(feedback, GES_FEEDBACKS)
CHOICE(role, GES_ROLES)
CHOICE(trim, GES_TRIMS)
CHOICE(timing, GES_TIMINGS)

#define MEMBER(constant, name)      \
  if (set & constant) {             \
    between = member(f, between);   \
    write_text(f, name);            \
  }
#define SET(kind, CHOICES)                      \
  static void write_##kind(FILE *f, int set) {  \
    const char *between = "";                   \
    fputc('[', f);                              \
    CHOICES(MEMBER)                             \
    fputc(']', f);                              \
  }
SET(invariants, GES_INVARIANTS)
SET(hints, GES_HINTS)

static void write_setting(FILE *f, ges_setting setting) {
  if (!setting.name) {
    fputs("null", f);
    return;
  }
  fputc('[', f);
  write_text(f, setting.name);
  fputs(", ", f);
  write_number(f, setting.value);
  fputc(']', f);
}

static void write_settings(FILE *f, const ges_setting *settings) {
  const char *between = "";
  fputc('[', f);
  for (size_t i = 0; i < sizeof(ges_settings) / sizeof *settings && settings[i].name; i++) {
    between = member(f, between);
    write_setting(f, settings[i]);
  }
  fputc(']', f);
}

static void write_levels(FILE *f, ges_levels levels) {
  const char *between = "";
  fputc('[', f);
  for (int i = 0; i < levels.n; i++) {
    between = member(f, between);
    write_number(f, levels.at[i]);
  }
  fputc(']', f);
}

#define FIELD(kind, name)           \
  between = member(f, between);     \
  fputs("\"" #name "\": ", f);      \
  write_##kind(f, of->name);
#define OBJECT(FIELDS)        \
  const char *between = "";   \
  fputc('{', f);              \
  FIELDS(FIELD)

static void write_prior(FILE *f, ges_prior prior) {
  const ges_prior *of = &prior;
  if (!of->shows_in) {
    fputs("null", f);
    return;
  }
  OBJECT(GES_PRIOR)
  fputc('}', f);
}

static void write_parameters(FILE *f, const effect_t *e) {
  fputs(", \"parameters\": [", f);
  for (int k = 0; k < e->n_parameters; k++) {
    const ges_effect_parameter *of = &e->parameters[k];
    if (k) fputs(", ", f);
    OBJECT(GES_EFFECT_PARAMETER)
    fputc('}', f);
  }
  fputc(']', f);
}

static void write_search(FILE *f, const effect_t *e) {
  fputs(", \"search\": [", f);
  for (int k = 0; k < GES_MAX_SEARCHES && e->search[k].amplitudes; k++) {
    const ges_search *of = &e->search[k];
    if (k) fputs(", ", f);
    OBJECT(GES_SEARCH)
    fputc('}', f);
  }
  fputc(']', f);
}

static void write_effect(FILE *f, const effect_t *of) {
  OBJECT(GES_EFFECT)
  write_parameters(f, of);
  write_search(f, of);
  fputc('}', f);
}

const char *ges_describe_effects(void) {
  static char *described;
  char *text = NULL;
  size_t size;
  if (described) return described;
  FILE *f = open_memstream(&text, &size);
  /* a comma is no decimal point, whatever the locale of the process */
  locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0), before = uselocale(plain);
  fputc('[', f);
  for (int i = 0; i < N_EFFECTS; i++) {
    if (i) fputs(",\n", f);
    write_effect(f, effects_known[i]);
  }
  fputc(']', f);
  uselocale(before);
  freelocale(plain);
  fclose(f);
  return described = text;
}
