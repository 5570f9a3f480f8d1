/* Public interface: check what comes in, group flights that share a plan, hand them to a kernel lane by lane. */
#define GES_W 1
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "../effects/effect.h"
#include "../firmware/firmware.h"
#include "../world/ground.h"
#include "columns.h"
#include "effects_known.h"
#include "kernel.h"
#include "parameters.h"

static const ges_parameter parameter_table[] = {
#define X(name, unit, value, low, high, doc) {#name, unit, doc, value, low, high},
#include "params.def"
#undef X
};

#define OF_NONE(name, unit, doc) {#name, unit, doc, 0},
#define OF_ROTOR(name, suffix, unit, doc, rotor) {#name #rotor #suffix, unit, "rotor " #rotor ": " doc, rotor},
static const ges_column column_table[] = {
#define X(name, unit, value, doc) OF_NONE(name, unit, doc)
#define XR(name, suffix, unit, value, doc)                                                                              \
  OF_ROTOR(name, suffix, unit, doc, 1) OF_ROTOR(name, suffix, unit, doc, 2) OF_ROTOR(name, suffix, unit, doc, 3)        \
  OF_ROTOR(name, suffix, unit, doc, 4) OF_ROTOR(name, suffix, unit, doc, 5) OF_ROTOR(name, suffix, unit, doc, 6)        \
  OF_ROTOR(name, suffix, unit, doc, 7) OF_ROTOR(name, suffix, unit, doc, 8) OF_ROTOR(name, suffix, unit, doc, 9)        \
  OF_ROTOR(name, suffix, unit, doc, 10) OF_ROTOR(name, suffix, unit, doc, 11) OF_ROTOR(name, suffix, unit, doc, 12)     \
  OF_ROTOR(name, suffix, unit, doc, 13) OF_ROTOR(name, suffix, unit, doc, 14) OF_ROTOR(name, suffix, unit, doc, 15)     \
  OF_ROTOR(name, suffix, unit, doc, 16)
#include "columns.def"
#undef X
#undef XR
};

#define OF_EACH_ROTOR(name, suffix, unit, doc) {#name "#" #suffix, unit, doc, GES_EACH_ROTOR},
static const ges_column replay_in_table[] = {
#define X(name, unit, doc) OF_NONE(name, unit, doc)
#define XR OF_EACH_ROTOR
#include "replay_in.def"
#undef X
#undef XR
};

static const ges_column replay_out_table[] = {
#define X(name, unit, value, doc) OF_NONE(name, unit, doc)
#define XR(name, suffix, unit, value, doc) OF_EACH_ROTOR(name, suffix, unit, doc)
#include "replay_out.def"
#undef X
#undef XR
};

static const ges_group group_table[] = {
#define X(quantity, reference, unit, needs, doc, expression) {#quantity, #reference, unit, needs, doc},
#include "../effects/groups.def"
#undef X
};
enum { N_GROUPS = sizeof group_table / sizeof *group_table };

static const ges_choice mode_table[] = {
#define X(name, runs_network, factor, doc) {#name, doc, 0, 0},
#include "../firmware/modes.def"
#undef X
};

static const ges_choice controller_table[] = {
#define X(name, run, impose, speeds_imposed, input_columns, rotor_columns, doc) {#name, doc, input_columns, rotor_columns},
#include "controllers.def"
#undef X
};

int ges_abi(void) { return GES_ABI; }

int ges_parameters(const ges_parameter **table) {
  *table = parameter_table;
  return N_PARAMETERS;
}

int ges_columns(const ges_column **table) {
  *table = column_table;
  return N_COLUMNS;
}

int ges_replay_columns(const ges_column **inputs, int *n_inputs, const ges_column **outputs, int *n_outputs) {
  *inputs = replay_in_table;
  *n_inputs = N_REPLAY_IN + N_REPLAY_IN_ROTOR;
  *outputs = replay_out_table;
  *n_outputs = N_REPLAY_OUT + N_REPLAY_OUT_ROTOR;
  return 1;
}

int ges_modes(const ges_choice **table) {
  *table = mode_table;
  return FF_MODES;
}

int ges_controllers(const ges_choice **table) {
  *table = controller_table;
  return N_CONTROLLERS;
}

const char *ges_effect(int id) { return id < 0 || id >= N_EFFECTS ? NULL : effects_known[id]->name; }

int ges_effect_parameters(int id, ges_parameter *list) {
  const effect_t *e = effects_known[id];
  for (int k = 0; k < e->n_parameters; k++) {
    const ges_effect_parameter *p = &e->parameters[k];
    list[k] = (ges_parameter){p->name, p->unit, p->doc, p->value, p->low, p->high};
  }
  return e->n_parameters;
}

int ges_groups(const ges_group **table) {
  *table = group_table;
  return N_GROUPS;
}

enum { ROTOR_STRIDE = P_rotor_2_x_m - P_rotor_1_x_m };

/* ---- checks ------------------------------------------------------------------------------------------------ */

static int fail(char *error, int size, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  if (error && size > 0) vsnprintf(error, (size_t)size, format, arguments);
  va_end(arguments);
  return 0;
}

static int check_choice(int k, const double *p, const ges_choice *table, int n, char *error, int size) {
  char known[256] = "";
  if (p[k] == floor(p[k])) return 1;
  for (int i = 0, used = 0; i < n && used < (int)sizeof known; i++)
    used += snprintf(known + used, sizeof known - (size_t)used, "%s%d %s", i ? ", " : "", i, table[i].name);
  return fail(error, size, "%s is %g; allowed are %s", parameter_table[k].name, p[k], known);
}

static int check_parameters(const double *p, char *error, int size) {
  for (int k = 0; k < N_PARAMETERS; k++) {
    const ges_parameter *known = &parameter_table[k];
    if (!(p[k] >= known->low && p[k] <= known->high))
      return fail(error, size, "%s is %g %s; allowed is %g to %g", known->name, p[k], known->unit, known->low, known->high);
  }
  if (!check_choice(P_mode, p, mode_table, FF_MODES, error, size)) return 0;
  if (!check_choice(P_control, p, controller_table, N_CONTROLLERS, error, size)) return 0;
  if (p[P_terrain_features_max] < p[P_terrain_features_min])
    return fail(error, size, "terrain_features_max is %g, below terrain_features_min %g; raise it", p[P_terrain_features_max],
                p[P_terrain_features_min]);
  if (p[P_rotors] != floor(p[P_rotors])) return fail(error, size, "rotors is %g; it takes a whole number", p[P_rotors]);
  double reach = 0.0;
  for (int i = 0; i < (int)p[P_rotors]; i++) {
    const double *rotor = p + P_rotor_1_x_m + i * ROTOR_STRIDE, *axis = p + P_rotor_1_axis_x + i * ROTOR_STRIDE;
    if (axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2] < 1e-6)
      return fail(error, size, "the axis of rotor %d has no length; upright is 0 0 1", i + 1);
    reach = fmax(reach, sqrt(rotor[0] * rotor[0] + rotor[1] * rotor[1] + rotor[2] * rotor[2]));
  }
  if (p[P_terrain_kind] == 1 && reach > 0.45 * p[P_terrain_length_m] / p[P_terrain_features_max])
    return fail(error, size, "rotors reach %g m from the centre, too far for terrain features every %g m; use fewer features", reach,
                p[P_terrain_length_m] / p[P_terrain_features_max]);
  if (p[P_duration_s] / p[P_dt_s] > 2e9)
    return fail(error, size, "duration_s / dt_s is %g steps; at most 2e9", p[P_duration_s] / p[P_dt_s]);
  return 1;
}

static int check_law(const ges_effects *e, char *error, int size) {
  if (e->n_terms < 0 || e->n_terms > GES_MAX_TERMS)
    return fail(error, size, "%d terms of laws; at most %d at once", e->n_terms, GES_MAX_TERMS);
  for (int j = 0; j < e->n_terms; j++) {
    const ges_term *term = &e->term[j];
    int known = term->channel >= 0 && term->channel < 6 && (term->scale == GES_SCALE_WEIGHT || term->scale == GES_SCALE_THRUST);
    for (int k = 0; k < GES_MAX_GROUPS; k++)
      known = known && term->power[k] >= 0 && term->magnitude[k] >= 0 && (k < N_GROUPS || term->power[k] + term->magnitude[k] == 0);
    if (!known) return fail(error, size, "term %d of the laws has no such channel, scale, group or power", j + 1);
    if (!isfinite(term->near_m[0]) || !isfinite(term->near_m[1]) || !(term->near_m[2] >= 0.0 && term->near_m[2] < 1e9))
      return fail(error, size, "term %d of the laws acts near x %g m, y %g m within %g m; these must be finite, the width not negative", j + 1,
                  term->near_m[0], term->near_m[1], term->near_m[2]);
    if (!isfinite(e->coefficient[j])) return fail(error, size, "term %d of the laws has coefficient %g; it must be finite", j + 1, e->coefficient[j]);
  }
  return 1;
}

static int check_effects(const ges_effects *e, char *error, int size) {
  const effect_t *thrust_gain = NULL;
  if (e->n < 0 || e->n > GES_MAX_EFFECTS) return fail(error, size, "%d effects; at most %d at once", e->n, GES_MAX_EFFECTS);
  for (int j = 0; j < e->n; j++) {
    if (e->id[j] < 0 || e->id[j] >= N_EFFECTS) return fail(error, size, "effect number %d does not exist", e->id[j]);
    const effect_t *known = effects_known[e->id[j]];
    for (int m = 0; m < j; m++)
      if (e->id[m] == e->id[j]) return fail(error, size, "effect %s is listed twice; once is enough", known->name);
    if (known->thrust_gain && thrust_gain)
      return fail(error, size, "effects %s and %s are both the thrust gain near the ground; switch one of them off", thrust_gain->name,
                  known->name);
    if (known->thrust_gain) thrust_gain = known;
    for (int k = 0; k < known->n_parameters; k++) {
      const ges_effect_parameter *q = &known->parameters[k];
      if (!(e->value[j][k] >= q->low && e->value[j][k] <= q->high))
        return fail(error, size, "%s of effect %s is %g %s; allowed is %g to %g", q->name, known->name, e->value[j][k], q->unit,
                    q->low, q->high);
    }
  }
  return check_law(e, error, size);
}

static int check_grid(const double *p, const ges_grid *g, char *error, int size) {
  if (p[P_terrain_kind] != 2) return 1;
  if (!g || !g->z_m) return fail(error, size, "terrain_kind is 2, a height map, but no height map was given");
  if (g->nx < 2 || g->ny < 2 || !(g->dx_m > 0.0) || !(g->dy_m > 0.0))
    return fail(error, size, "height map is %d x %d with spacing %g x %g m; needs 2 x 2 or more and positive spacing", g->nx, g->ny,
                g->dx_m, g->dy_m);
  return 1;
}

static int check_inputs(const ges_flight *f, char *error, int size) {
  const double *p = f->parameters;
  const ges_choice *controller = &controller_table[(int)p[P_control]];
  int replays = controller->rotor_columns;
  if (p[P_attitude_imposed] != 0.0 && !replays)
    return fail(error, size, "attitude_imposed needs a control that replays; the input table of %s holds references", controller->name);
  if (replays && !f->inputs) return fail(error, size, "control is %s, but no replay table was given", controller->name);
  if (f->inputs && f->n_inputs < 1) return fail(error, size, "the input table has no row; give one or more, or no table");
  return 1;
}

static int check_network(const double *p, char *error, int size) {
  if (!some(ge_ff_runs_network((float)p[P_mode])) && p[P_shadow] == 0.0) return 1;
  if (p[P_rotors] != 4.0) return fail(error, size, "the network reads the speeds of 4 rotors, and this vehicle has %g; choose another mode", p[P_rotors]);
  if (ge_ff_network_is_sound()) return 1;
  return fail(error, size, "the compiled network does not give the output stored in ge_ff_mlp_weights.h; export it again and rebuild");
}

static int check_flight(const ges_flight *f, int number, char *error, int size) {
  char reason[400];
  if (check_parameters(f->parameters, reason, sizeof reason) && check_effects(&f->effects, reason, sizeof reason) &&
      check_grid(f->parameters, f->grid, reason, sizeof reason) && check_inputs(f, reason, sizeof reason) &&
      check_network(f->parameters, reason, sizeof reason))
    return 1;
  return fail(error, size, "flight %d: %s", number, reason);
}

/* ---- units --------------------------------------------------------------------------------------------------- */

static const kernel_t *const kernels[][4] = {
#ifdef __x86_64__
#define X(rotors) {&kernel_r##rotors##_w1, &kernel_r##rotors##_w2, &kernel_r##rotors##_w4, &kernel_r##rotors##_w8},
#else
#define X(rotors) {&kernel_r##rotors##_w1, &kernel_r##rotors##_w2, NULL, NULL},
#endif
    EACH_UNIT(X)
#undef X
};
static const int unit_rotors[] = {
#define X(rotors) rotors,
    EACH_UNIT(X)
#undef X
};
enum { N_UNITS = sizeof kernels / sizeof *kernels };

/* Whether all rotors stand upright, and are alike. */
static int plain_rotors(const double *p) {
  for (int i = 0; i < (int)p[P_rotors]; i++) {
    const double *axis = p + P_rotor_1_axis_x + i * ROTOR_STRIDE, *share = p + P_rotor_1_thrust + i * ROTOR_STRIDE;
    if (axis[0] != 0.0 || axis[1] != 0.0 || axis[2] != 1.0 || share[0] != 1.0 || share[1] != 1.0 || share[2] != 1.0) return 0;
  }
  return 1;
}

/* The unit that flies a vehicle: that of its number of rotors, or the last one, which flies any. */
static int unit_of(const double *p) {
  for (int k = 0; k < N_UNITS - 1; k++)
    if (p[P_rotors] == (double)unit_rotors[k] && plain_rotors(p)) return k;
  return N_UNITS - 1;
}

/* ---- plans ------------------------------------------------------------------------------------------------- */

static int compare_int(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

static void set_effects(plan_t *plan, const ges_effects *e) {
  plan->n_effects = e->n;
  for (int j = 0; j < e->n; j++) plan->effect[j] = e->id[j];
  qsort(plan->effect, (size_t)e->n, sizeof *plan->effect, compare_int);
  plan->n_terms = e->n_terms;
  memcpy(plan->term, e->term, (size_t)e->n_terms * sizeof *e->term);
}

static int n_steps(const double *p) { return (int)floor(p[P_duration_s] / p[P_dt_s] + 0.5); }

int ges_rows(const double *p) {
  char reason[400];
  return check_parameters(p, reason, sizeof reason) ? n_steps(p) / (int)p[P_record_every] + 1 : 0;
}

/* What sets of effects share that are replayed together; all of a plan that a replay reads. */
static plan_t replay_plan(const ges_effects *e) {
  plan_t plan;
  memset(&plan, 0, sizeof plan);
  set_effects(&plan, e);
  return plan;
}

static plan_t plan_of(const ges_flight *f) {
  plan_t plan = replay_plan(&f->effects);
  const double *p = f->parameters;
  plan.rotors = (int)p[P_rotors];
  plan.allocation = (int)p[P_allocation];
  plan.n_steps = n_steps(p);
  plan.control_every = (int)p[P_control_every];
  plan.telemetry_every = (int)p[P_telemetry_every];
  plan.record_every = (int)p[P_record_every];
  plan.integrator = (int)p[P_integrator];
  plan.control = (int)p[P_control];
  plan.attitude_imposed = (int)p[P_attitude_imposed];
  plan.references = f->inputs && controller_table[plan.control].input_columns == GES_REFERENCE_COLUMNS;
  return plan;
}

static int same_plan(const ges_flight *a, const ges_flight *b) {
  plan_t x = plan_of(a), y = plan_of(b);
  return !memcmp(&x, &y, sizeof x) && unit_of(a->parameters) == unit_of(b->parameters) && a->parameters[P_terrain_kind] == b->parameters[P_terrain_kind] && !a->inputs == !b->inputs;
}

/* ---- flying ------------------------------------------------------------------------------------------------ */

/* Lanes of the widest vectors that this processor has instructions for; sim_c/Makefile says which a width needs. */
static int lanes_of_the_processor(void) {
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw"))
    return 8;
  if (__builtin_cpu_supports("avx2")) return 4;
#endif
  return 2;
}

/* Lanes that are used where `lanes` are asked for: the most that the processor has where that is 0 (choose) or more than it
 * has; 0: no such width. */
static int lanes_used(int lanes) {
  int most = lanes_of_the_processor();
  if (lanes != 0 && lanes != 1 && lanes != 2 && lanes != 4 && lanes != 8) return 0;
  return lanes == 0 || lanes > most ? most : lanes;
}

/* The unit of one lane has AVX2, too, for rotors side by side: on a processor without it one flight takes both lanes of the
 * unit of two. */
static const kernel_t *kernel_of(const double *parameters, int lanes) {
  int width = 0;
#ifdef __x86_64__
  if (lanes_of_the_processor() < 4 && lanes < 2) lanes = 2;
#endif
  while (1 << width < lanes) width++;
  return kernels[unit_of(parameters)][width];
}

static int fly_together(ges_flight **flights, int n, const kernel_t *kernel, const int *columns, int n_columns, char *error, int size) {
  terrain_t terrain[8];
  const void *pointer[8];
  int made = 0, good = 1;
  plan_t plan = plan_of(flights[0]);
  for (; made < n && good; made++) {
    good = terrain_make(&terrain[made], flights[made]->parameters, flights[made]->grid);
    pointer[made] = &terrain[made];
  }
  if (!good) fail(error, size, "out of memory for the terrain");
  else if (!kernel->fly(&plan, flights, pointer, n, columns, n_columns))
    good = fail(error, size, "the rotors' places, spins and axes cannot make thrust and three moments independently; check rotor_*_x_m, _y_m, _spin, _axis_*");
  for (int i = 0; i < made; i++) terrain_free(&terrain[i]);
  return good;
}

/* Next flights of the same plan, at most `most`; flown ones are marked. */
static int collect(ges_flight *flights, int n, int first, char *flown, int most, ges_flight **out) {
  int m = 0;
  for (int i = first; i < n && m < most; i++)
    if (!flown[i] && (i == first || same_plan(&flights[first], &flights[i]))) {
      out[m++] = &flights[i];
      flown[i] = 1;
    }
  return m;
}

int ges_fly(ges_flight *flights, int n, const int *columns, int n_columns, int lanes, char *error, int error_size) {
  ges_flight *together[8];
  int good = 1, most = lanes_used(lanes);
  if (!most) return fail(error, error_size, "lanes is %d; allowed are 0 (choose), 1, 2, 4 and 8", lanes);
  for (int c = 0; c < n_columns; c++)
    if (columns[c] < 0 || columns[c] >= N_COLUMNS) return fail(error, error_size, "column number %d does not exist", columns[c]);
  for (int i = 0; i < n; i++) {
    if (!check_flight(&flights[i], i, error, error_size)) return 0;
    flights[i].stopped_row = -1;
    flights[i].stopped_field = NULL;
    flights[i].stopped_t_s = NAN;
  }
  char *flown = calloc((size_t)n + 1, 1);
  if (!flown) return fail(error, error_size, "out of memory");
  for (int i = 0; i < n && good; i++) {
    if (flown[i]) continue;
    int m = collect(flights, n, i, flown, most, together);
    const kernel_t *fit = kernel_of(flights[i].parameters, lanes == 0 && m == 1 ? 1 : most);
    good = fly_together(together, m, fit, columns, n_columns, error, error_size);
  }
  free(flown);
  return good;
}

static int has_states(const plan_t *plan) {
  for (int j = 0; j < plan->n_effects; j++)
    if (effects_known[plan->effect[j]]->n_states > 0) return 1;
  return 0;
}

/* How many of the sets from the first on go together: those that share its plan, at most `most`. */
static int alike(const plan_t *plan, const ges_effects *sets, int n, int most) {
  for (int m = 1; m < n && m < most; m++) {
    plan_t other = replay_plan(&sets[m]);
    if (memcmp(plan, &other, sizeof other)) return m;
  }
  return n < most ? n : most;
}

int ges_replay(const double *parameters, const ges_effects *sets, int n_sets, const ges_grid *grid, const double *in, int64_t n,
               const int *columns, int n_columns, double *out, int lanes, char *error, int error_size) {
  terrain_t terrain;
  int most = lanes_used(lanes);
  if (!most) return fail(error, error_size, "lanes is %d; allowed are 0 (choose), 1, 2, 4 and 8", lanes);
  if (!check_parameters(parameters, error, error_size) || !check_grid(parameters, grid, error, error_size)) return 0;
  for (int i = 0; i < n_sets; i++)
    if (!check_effects(&sets[i], error, error_size)) return 0;
  int width = N_REPLAY_OUT + N_REPLAY_OUT_ROTOR * (int)parameters[P_rotors];
  for (int c = 0; c < n_columns; c++)
    if (columns[c] < 0 || columns[c] >= width) return fail(error, error_size, "replay column %d does not exist", columns[c]);
  if (!terrain_make(&terrain, parameters, grid)) return fail(error, error_size, "out of memory for the terrain");
  for (int i = 0, m; i < n_sets; i += m) {
    const ges_effects *together[8];
    double *to[8];
    plan_t plan = replay_plan(&sets[i]);
    int in_order = has_states(&plan);
    m = in_order ? alike(&plan, &sets[i], n_sets - i, most) : 1;
    for (int k = 0; k < m; k++) {
      together[k] = &sets[i + k];
      to[k] = out + (int64_t)(i + k) * n_columns * n;
    }
    const kernel_t *fit = kernel_of(parameters, lanes == 0 && in_order && m == 1 ? 1 : most);
    fit->replay(parameters, &plan, together, to, m, &terrain, in, n, columns, n_columns);
  }
  terrain_free(&terrain);
  return 1;
}

int ges_terrain(const double *parameters, const ges_grid *grid, const double *x_m, const double *y_m, int64_t n,
                double *height_m, double *slope_x, double *slope_y, double *curvature_1_m, char *error, int error_size) {
  terrain_t terrain;
  const terrain_t *one = &terrain;
  ground_lanes_t lanes;
  if (!check_parameters(parameters, error, error_size) || !check_grid(parameters, grid, error, error_size)) return 0;
  if (!terrain_make(&terrain, parameters, grid)) return fail(error, error_size, "out of memory for the terrain");
  ground_make(&lanes, &one);
  for (int64_t i = 0; i < n; i++) {
    ground_move(&lanes, x_m[i]);
    ground_t g = ground_at(&lanes, x_m[i], y_m[i]);
    height_m[i] = g.height;
    slope_x[i] = g.gx;
    slope_y[i] = g.gy;
    curvature_1_m[i] = g.laplacian;
  }
  terrain_free(&terrain);
  return 1;
}

int ges_network(const float *features, float *factor) {
  *factor = ge_ff_network(features);
  return 1;
}
