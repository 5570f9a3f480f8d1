/* ges_sim: fly what a text file describes; the second face of the library, for debuggers and sanitizers.
 *
 *   ges_sim FLIGHTS [--out FILE] [--lanes N]
 *
 * FLIGHTS holds one item a line, "#" starts a comment:
 *   flight                        begins a flight with all defaults
 *   mass_kg = 1.2                 sets a parameter of it
 *   effect rotor_drag             switches an effect on with its typical parameters
 *   effect.rotor_drag.k_kg = 1e-4 sets a parameter of it
 *   term 1 0 0.1 V_x R R |V_x|    a term of a law: channel (0 to 5), scale (0 weight, 1 thrust), coefficient, groups
 *   inputs FILE                   table of numbers: 14 columns of references, or of a replay one for every rotor and 8, as control says
 *   columns t_s p_z_m ...         what is recorded, for all flights (default: every column, of the first flight's rotors)
 * Output: CSV on standard output, or raw doubles, flight after flight, into FILE.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../include/ges.h"
#include "../sim/parameters.h"

enum { MAX_FLIGHTS = 4096, MAX_COLUMNS = 256, LINE = 8192 };

typedef struct {
  ges_flight *flight;
  int n, n_columns, columns[MAX_COLUMNS];
} script_t;

static void stop(const char *where, int line, const char *what) {
  fprintf(stderr, "ges_sim: %s:%d: %s\n", where, line, what);
  exit(1);
}

static void *need(void *memory) {
  if (!memory) stop("memory", 0, "out of memory");
  return memory;
}

static int parameter_index(const char *name) {
  const ges_parameter *table;
  int n = ges_parameters(&table);
  for (int k = 0; k < n; k++)
    if (!strcmp(table[k].name, name)) return k;
  return -1;
}

static int column_index(const char *name) {
  const ges_column *table;
  int n = ges_columns(&table);
  for (int k = 0; k < n; k++)
    if (!strcmp(table[k].name, name)) return k;
  return -1;
}

static int effect_index(const char *name) {
  for (int id = 0; ges_effect(id); id++)
    if (!strcmp(ges_effect(id), name)) return id;
  return -1;
}

static void begin_flight(script_t *s, const char *path, int line) {
  const ges_parameter *table;
  int n = ges_parameters(&table);
  if (s->n == MAX_FLIGHTS) stop(path, line, "too many flights; at most 4096");
  double *values = need(malloc(sizeof *values * (size_t)n));
  for (int k = 0; k < n; k++) values[k] = table[k].value;
  ges_flight *f = &s->flight[s->n++];
  memset(f, 0, sizeof *f);
  f->parameters = values;
}

static int effect_slot(ges_flight *f, const char *name, const char *path, int line) {
  int id = effect_index(name);
  if (id < 0) stop(path, line, "unknown effect; see the effects folder for names");
  for (int j = 0; j < f->effects.n; j++)
    if (f->effects.id[j] == id) return j;
  if (f->effects.n == GES_MAX_EFFECTS) stop(path, line, "too many effects; at most 40");
  int j = f->effects.n++;
  f->effects.id[j] = id;
  ges_parameter known[GES_MAX_PARAMETERS];
  for (int k = 0, n = ges_effect_parameters(id, known); k < n; k++) f->effects.value[j][k] = known[k].value;
  return j;
}

static void set_effect(ges_flight *f, char *name, double value, const char *path, int line) {
  ges_parameter known[GES_MAX_PARAMETERS];
  char *dot = strchr(name, '.');
  if (!dot) stop(path, line, "expected effect.NAME.PARAMETER = VALUE");
  *dot = 0;
  int j = effect_slot(f, name, path, line);
  for (int k = 0, n = ges_effect_parameters(f->effects.id[j], known); k < n; k++)
    if (!strcmp(known[k].name, dot + 1)) {
      f->effects.value[j][k] = value;
      return;
    }
  stop(path, line, "unknown parameter of this effect");
}

static int group_index(const char *name) {
  const ges_group *table;
  int n = ges_groups(&table);
  for (int k = 0; k < n; k++)
    if (!strcmp(table[k].quantity, name)) return k;
  return -1;
}

static void read_term(ges_flight *f, char *text, const char *path, int line) {
  if (f->effects.n_terms == GES_MAX_TERMS) stop(path, line, "too many terms of laws");
  ges_term *term = &f->effects.term[f->effects.n_terms];
  char coefficient[64];
  int used;
  if (sscanf(text, "%d %d %63s%n", &term->channel, &term->scale, coefficient, &used) != 3)
    stop(path, line, "expected term CHANNEL SCALE COEFFICIENT GROUP ... near:X,Y,WIDTH");
  f->effects.coefficient[f->effects.n_terms++] = strtod(coefficient, NULL);
  for (char *name = strtok(text + used, " \t"); name; name = strtok(NULL, " \t")) {
    double *near = term->near_m;
    if (sscanf(name, "near:%lf,%lf,%lf", &near[0], &near[1], &near[2]) == 3) continue;
    int magnitude = *name == '|';
    if (magnitude) name++;
    name[strcspn(name, "|")] = 0;
    int k = group_index(name);
    if (k < 0) stop(path, line, "unknown group; see effects/groups.def");
    ++*(magnitude ? &term->magnitude[k] : &term->power[k]);
  }
}

/* A whole number from 0 to `most`, or -1. */
static int whole(double value, int most) { return value >= 0.0 && value <= most ? (int)value : -1; }

static void read_inputs(ges_flight *f, const char *file, const char *path, int line) {
  FILE *in = fopen(file, "r");
  size_t n = 0, room = 1024;
  double value, *values = need(malloc(room * sizeof *values));
  if (!in) stop(path, line, "cannot read the inputs file");
  while (fscanf(in, "%lf", &value) == 1) {
    if (n == room) values = need(realloc(values, (room *= 2) * sizeof *values));
    values[n++] = value;
  }
  fclose(in);
  const ges_choice *controllers;
  int known = ges_controllers(&controllers), control = whole(f->parameters[P_control], known - 1);
  int rotors = whole(f->parameters[P_rotors], GES_MAX_ROTORS);
  if (control < 0) stop(path, line, "no such control; see sim/controllers.def");
  if (rotors < 1) stop(path, line, "rotors is out of bounds; see sim/params.def");
  int width = controllers[control].input_columns + controllers[control].rotor_columns * rotors;
  if (n == 0 || n % (size_t)width) stop(path, line, "inputs file does not hold whole rows (14 references, or a column for every rotor and 8 of a replay; set control and rotors first)");
  f->inputs = values;
  f->n_inputs = (int)(n / (size_t)width);
}

static void read_columns(script_t *s, char *names, const char *path, int line) {
  for (char *name = strtok(names, " \t"); name; name = strtok(NULL, " \t")) {
    int c = column_index(name);
    if (c < 0 || s->n_columns == MAX_COLUMNS) stop(path, line, "unknown column");
    s->columns[s->n_columns++] = c;
  }
}

static void read_assignment(ges_flight *f, char *text, const char *path, int line) {
  char *equals = strchr(text, '='), *end, name[256];
  if (!equals || sscanf(text, "%255[^= \t]", name) != 1) stop(path, line, "expected NAME = VALUE");
  double value = strtod(equals + 1, &end);
  if (end == equals + 1 || strspn(end, " \t") != strlen(end)) stop(path, line, "the value is not a number");
  if (!strncmp(name, "effect.", 7)) {
    set_effect(f, name + 7, value, path, line);
    return;
  }
  int k = parameter_index(name);
  if (k < 0) stop(path, line, "unknown parameter");
  ((double *)f->parameters)[k] = value;
}

static void read_line(script_t *s, char *text, const char *path, int line) {
  char word[64] = "", rest[LINE] = "";
  text[strcspn(text, "#\r\n")] = 0;
  if (sscanf(text, "%63s %8191[^\n]", word, rest) < 1) return;
  if (!strcmp(word, "columns")) {
    read_columns(s, rest, path, line);
    return;
  }
  if (!strcmp(word, "flight")) {
    begin_flight(s, path, line);
    return;
  }
  if (s->n == 0) stop(path, line, "say 'flight' before its settings");
  ges_flight *f = &s->flight[s->n - 1];
  if (!strcmp(word, "effect")) effect_slot(f, rest, path, line);
  else if (!strcmp(word, "term")) read_term(f, rest, path, line);
  else if (!strcmp(word, "inputs")) read_inputs(f, rest, path, line);
  else read_assignment(f, text, path, line);
}

static void read_script(script_t *s, const char *path) {
  char text[LINE];
  FILE *in = fopen(path, "r");
  if (!in) stop(path, 0, strerror(errno));
  for (int line = 1; fgets(text, sizeof text, in); line++) read_line(s, text, path, line);
  fclose(in);
  if (s->n == 0) stop(path, 0, "no flight in this file; begin one with a line 'flight'");
  const ges_column *table;
  int all = ges_columns(&table);
  if (s->n_columns > 0) return;
  for (int c = 0; c < all; c++)
    if (table[c].rotor <= s->flight[0].parameters[P_rotors]) s->columns[s->n_columns++] = c;
}

static void write_csv(const script_t *s) {
  const ges_column *table;
  ges_columns(&table);
  printf("flight");
  for (int c = 0; c < s->n_columns; c++) printf(",%s", table[s->columns[c]].name);
  printf("\n");
  for (int i = 0; i < s->n; i++)
    for (int row = 0; row < s->flight[i].n_rows; row++) {
      printf("%d", i);
      for (int c = 0; c < s->n_columns; c++) printf(",%.17g", s->flight[i].out[(int64_t)row * s->n_columns + c]);
      printf("\n");
    }
}

static void write_raw(const script_t *s, const char *path) {
  FILE *out = fopen(path, "wb");
  if (!out) stop(path, 0, strerror(errno));
  for (int i = 0; i < s->n; i++) {
    size_t n = (size_t)s->flight[i].n_rows * (size_t)s->n_columns;
    if (fwrite(s->flight[i].out, sizeof(double), n, out) != n) stop(path, 0, "could not write");
  }
  if (fclose(out)) stop(path, 0, strerror(errno));
}

static int report_stops(const script_t *s) {
  int stopped = 0;
  for (int i = 0; i < s->n; i++) {
    const ges_flight *f = &s->flight[i];
    if (f->stopped_row < 0) continue;
    fprintf(stderr, "ges_sim: flight %d (seed %.0f) stopped at t = %g s: %s is not finite\n", i, f->parameters[P_seed],
            f->stopped_t_s, f->stopped_field);
    stopped = 1;
  }
  return stopped;
}

int main(int argc, char **argv) {
  const char *script = NULL, *out = NULL;
  int lanes = 0;
  char error[512];
  for (int k = 1; k < argc; k++) {
    if (!strcmp(argv[k], "--out") && k + 1 < argc) out = argv[++k];
    else if (!strcmp(argv[k], "--lanes") && k + 1 < argc) lanes = atoi(argv[++k]);
    else if (argv[k][0] != '-' && !script) script = argv[k];
    else script = NULL, k = argc;
  }
  if (!script) {
    fprintf(stderr, "usage: ges_sim FLIGHTS [--out FILE] [--lanes N]\n");
    return 2;
  }
  script_t s = {.flight = need(calloc(MAX_FLIGHTS, sizeof(ges_flight)))};
  read_script(&s, script);
  for (int i = 0; i < s.n; i++) {
    s.flight[i].n_rows = ges_rows(s.flight[i].parameters);
    s.flight[i].out = need(malloc(sizeof(double) * (size_t)s.flight[i].n_rows * (size_t)s.n_columns));
  }
  if (!ges_fly(s.flight, s.n, s.columns, s.n_columns, lanes, error, sizeof error)) {
    fprintf(stderr, "ges_sim: %s\n", error);
    return 1;
  }
  if (out) write_raw(&s, out);
  else write_csv(&s);
  int stopped = report_stops(&s);
  for (int i = 0; i < s.n; i++) {
    free((void *)s.flight[i].parameters);
    free((void *)s.flight[i].inputs);
    free(s.flight[i].out);
  }
  free(s.flight);
  return stopped;
}
