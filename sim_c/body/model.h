/* The vehicle: what is constant during a flight, the state vector, and the sample that effects read.
 *
 * State y: position p and velocity v (world), attitude q, body rates omega, rotor speeds, then the effects' extra
 * states. build_sample() serves simulated and recorded states alike.
 */
#ifndef GES_MODEL_H
#define GES_MODEL_H

#include "../effects/law.h"
#include "../sim/parameters.h"
#include "../world/ground.h"

enum { Y_P = 0, Y_V = 3, Y_Q = 6, Y_OMEGA = 10, Y_SPEED = 13, Y_X = Y_SPEED + GES_ROTORS, Y_MAX = Y_X + GES_MAX_EFFECTS * GES_MAX_STATES };

typedef struct {
  vd mass, inertia[3], rho, gravity, thrust_coefficient, torque_coefficient, motor_lag, speed_max;
  vd battery_nominal, gear_height, gear_stiffness, gear_damping, gear_friction;
  vd hub[3][GES_ROTORS]; /* each coordinate of all rotors, for rotors side by side */
  vd radius[GES_ROTORS], spin[GES_ROTORS];
#if GES_GENERAL
  int rotors;
  vd axis[GES_ROTORS][3], thrust_share[GES_ROTORS], torque_share[GES_ROTORS], lag_share[GES_ROTORS];
#endif
} vehicle_t;

typedef struct {
  int n, n_states;
  const effect_t *effect[GES_MAX_EFFECTS];
  vd p[GES_MAX_EFFECTS][GES_MAX_PARAMETERS];
  int first_state[GES_MAX_EFFECTS];
  thrust_gain_hook *thrust_gain; /* of the effect that has one, or NULL, and its parameters */
  const vd *thrust_gain_p;
  int wants_agl;
  int any_rates; /* of extra states; those that a reading advances have none */
  law_t law;
} active_t;

/* One named parameter of every lane. */
static inline vd column(const double *const *parameters, int index) {
  vd v = all_lanes(0.0);
  for (int i = 0; i < GES_W; i++) set_lane(&v, i, parameters[i][index]);
  return v;
}

static inline void load_rotors(vehicle_t *b, const double *const *p) {
  const int stride = P_rotor_2_x_m - P_rotor_1_x_m;
#if GES_GENERAL
  b->rotors = (int)p[0][P_rotors];
#endif
  for (int i = 0; i < ROTORS_OF(b); i++) {
    for (int k = 0; k < 3; k++) b->hub[k][i] = column(p, P_rotor_1_x_m + i * stride + k);
    b->radius[i] = column(p, P_rotor_1_radius_m + i * stride);
    b->spin[i] = column(p, P_rotor_1_spin + i * stride);
#if GES_GENERAL
    vd *a = b->axis[i], length = all_lanes(0.0);
    for (int k = 0; k < 3; k++) {
      a[k] = column(p, P_rotor_1_axis_x + i * stride + k);
      length += a[k] * a[k];
    }
    for (int k = 0; k < 3; k++) a[k] = a[k] / lane_sqrt(length);
    b->thrust_share[i] = column(p, P_rotor_1_thrust + i * stride);
    b->torque_share[i] = column(p, P_rotor_1_torque + i * stride);
    b->lag_share[i] = column(p, P_rotor_1_lag + i * stride);
#endif
  }
}

static inline void load_vehicle(vehicle_t *b, const double *const *p) {
  b->mass = column(p, P_mass_kg);
  for (int k = 0; k < 3; k++) b->inertia[k] = column(p, P_ixx_kg_m2 + k);
  b->rho = column(p, P_rho_kg_m3);
  b->gravity = column(p, P_gravity_m_s2);
  b->thrust_coefficient = column(p, P_thrust_coefficient_N_s2);
  b->torque_coefficient = column(p, P_torque_coefficient_Nm_s2);
  b->motor_lag = column(p, P_motor_time_constant_s);
  b->speed_max = column(p, P_max_rotor_speed_rad_s);
  b->battery_nominal = column(p, P_battery_nominal_V);
  b->gear_height = column(p, P_gear_height_m);
  b->gear_stiffness = column(p, P_gear_stiffness_N_m);
  b->gear_damping = column(p, P_gear_damping_N_s_m);
  b->gear_friction = column(p, P_gear_friction);
  load_rotors(b, p);
}

static inline void rotation_matrix(const vd q[4], vd r[9]) {
  vd w = q[0], x = q[1], y = q[2], z = q[3];
  r[0] = 1.0 - 2.0 * (y * y + z * z);
  r[1] = 2.0 * (x * y - w * z);
  r[2] = 2.0 * (x * z + w * y);
  r[3] = 2.0 * (x * y + w * z);
  r[4] = 1.0 - 2.0 * (x * x + z * z);
  r[5] = 2.0 * (y * z - w * x);
  r[6] = 2.0 * (x * z - w * y);
  r[7] = 2.0 * (y * z + w * x);
  r[8] = 1.0 - 2.0 * (x * x + y * y);
}

static inline vd row_dot(const vd *r, const vd a[3]) { return r[0] * a[0] + r[1] * a[1] + r[2] * a[2]; }
static inline vr row_dots(const vd *r, const vr a[3]) { return r[0] * a[0] + r[1] * a[1] + r[2] * a[2]; }
static inline vd column_dot(const vd *r, int k, const vd a[3]) { return r[k] * a[0] + r[3 + k] * a[1] + r[6 + k] * a[2]; }

static inline void sample_constants(const vehicle_t *b, const active_t *a, sample_t *s) {
  s->mass = b->mass;
  for (int k = 0; k < 3; k++) s->inertia[k] = b->inertia[k];
  s->rho = b->rho;
  s->gravity = b->gravity;
  s->thrust_coefficient = b->thrust_coefficient;
  s->torque_coefficient = b->torque_coefficient;
  s->motor_lag = b->motor_lag;
  s->speed_max = b->speed_max;
  s->battery_nominal = b->battery_nominal;
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->adjust) a->effect[j]->adjust(s, a->p[j]);
  s->inverse_mass = 1.0 / s->mass;
  for (int k = 0; k < 3; k++) s->inverse_inertia[k] = 1.0 / s->inertia[k];
}

static inline void sample_state(const vd *y, sample_t *s) {
  for (int k = 0; k < 3; k++) {
    s->p[k] = y[Y_P + k];
    s->v[k] = y[Y_V + k];
    s->omega[k] = y[Y_OMEGA + k];
  }
  for (int k = 0; k < 4; k++) s->q[k] = y[Y_Q + k];
  for (int i = 0; i < ROTORS_OF(s); i++) s->speed[i] = y[Y_SPEED + i];
  rotation_matrix(s->q, s->r);
}

static inline void sample_rotors(const vehicle_t *b, ground_lanes_t *g, sample_t *s) {
  ground_move(g, s->p[0]);
  s->map = g;
  for (int i = 0; i < ROTORS_OF(s); i += GES_ABREAST) {
    vr hub[3] = {rotors_from(b->hub[0] + i), rotors_from(b->hub[1] + i), rotors_from(b->hub[2] + i)};
    ground_wide_t under = ground_under(g, s->p[0] + row_dots(s->r, hub), s->p[1] + row_dots(s->r + 3, hub));
    put_grounds(&s->under, i, &under);
    put_rotors(s->height + i, s->p[2] + row_dots(s->r + 6, hub) - under.height);
    vr speed = rotors_from(s->speed + i), w2 = speed * speed, thrust = s->thrust_coefficient * w2, torque = s->torque_coefficient * w2;
#if GES_GENERAL
    thrust = thrust * rotors_from(s->thrust_share + i);
    torque = torque * rotors_from(s->torque_share + i);
#endif
    put_rotors(s->thrust + i, thrust);
    put_rotors(s->torque + i, torque);
  }
}

static inline void sample_center(const ground_lanes_t *g, sample_t *s) {
  s->ground = ground_at(g, s->p[0], s->p[1]);
  s->agl = s->p[2] - s->ground.height;
}

static inline void sample_air(const active_t *a, const vd *y, sample_t *s) {
  vd relative[3];
  for (int k = 0; k < 3; k++) s->wind[k] = all_lanes(0.0);
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->blow) a->effect[j]->blow(s, a->p[j], y + Y_X + a->first_state[j], s->wind);
  for (int k = 0; k < 3; k++) relative[k] = s->v[k] - s->wind[k];
  for (int k = 0; k < 3; k++) s->air[k] = column_dot(s->r, k, relative);
}

/* Everything effects may read, from the state; s->t, s->u, s->battery and the rates are the caller's. */
static inline void build_sample(const vehicle_t *b, const active_t *a, ground_lanes_t *g, const vd *y, sample_t *s) {
  sample_state(y, s);
  sample_rotors(b, g, s);
  if (a->wants_agl) sample_center(g, s);
  sample_air(a, y, s);
  if (a->thrust_gain) a->thrust_gain(s, a->thrust_gain_p, s->thrust_gain);
}

/* Hubs, radii and spins do not change along a flight. */
static inline void start_sample(const vehicle_t *b, const active_t *a, sample_t *s) {
  memset(s, 0, sizeof *s);
#if GES_GENERAL
  s->rotors = b->rotors;
  memcpy(s->axis, b->axis, sizeof s->axis);
  memcpy(s->thrust_share, b->thrust_share, sizeof s->thrust_share);
  memcpy(s->torque_share, b->torque_share, sizeof s->torque_share);
  for (int i = 0; i < s->rotors; i++) s->inverse_lag_share[i] = 1.0 / b->lag_share[i];
#endif
  sample_constants(b, a, s);
  for (int i = 0; i < ROTORS_OF(s); i++)
    for (int k = 0; k < 3; k++) s->hub[i][k] = b->hub[k][i];
  memcpy(s->radius, b->radius, sizeof s->radius);
  memcpy(s->spin, b->spin, sizeof s->spin);
  s->battery = all_lanes(NAN);
  s->thrust_gain_at = a->thrust_gain;
  s->thrust_gain_p = a->thrust_gain_p;
}

/* Thrust increments near the ground. */
static inline void add_ground(const active_t *a, const sample_t *s, const vd *y, vd *dy, wrench_t *w) {
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->ground)
      a->effect[j]->ground(s, a->p[j], y + Y_X + a->first_state[j], dy + Y_X + a->first_state[j], w);
}

/* Whether an effect gives the rates of extra states. */
static inline int has_rates(const effect_t *e) { return e->n_states && (e->ground || e->wrench || e->drive); }

static inline void add_wrench(const active_t *a, int j, const sample_t *s, const vd *y, vd *dy, wrench_t *w) {
  if (a->effect[j]->wrench)
    a->effect[j]->wrench(s, a->p[j], y + Y_X + a->first_state[j], dy + Y_X + a->first_state[j], w);
}

/* All other wrench increments. */
static inline void add_wrenches(const active_t *a, const sample_t *s, const vd *y, vd *dy, wrench_t *w) {
  for (int j = 0; j < a->n; j++) add_wrench(a, j, s, y, dy, w);
  add_law(&a->law, s, w);
}

/* Ground effect factor of every rotor from the thrust increments near the ground. */
static inline void set_factor(sample_t *s, const vd thrust_added[GES_ROTORS]) {
  for (int i = 0; i < ROTORS_OF(s); i++)
    s->factor[i] = 1.0 + thrust_added[i] / lane_max(s->thrust[i], all_lanes(1e-12));
  s->factor_mean = mean(s, s->factor);
}

/* Commanded rotor speeds and lags, effects included; w_cmd is held within [0, w_max]. */
static inline void add_drive(const active_t *a, const sample_t *s, const vd *y, vd *dy, drive_t *d) {
  clear(d->speed, ROTORS_OF(s));
  d->lag_up = d->lag_down = d->battery = all_lanes(0.0);
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->drive)
      a->effect[j]->drive(s, a->p[j], y + Y_X + a->first_state[j], dy + Y_X + a->first_state[j], d);
  for (int i = 0; i < ROTORS_OF(s); i++)
    d->speed[i] = clamp(s->speed_max * s->u[i] + d->speed[i], all_lanes(0.0), s->speed_max);
  d->lag_up = lane_max(s->motor_lag + d->lag_up, all_lanes(1e-4));
  d->lag_down = lane_max(s->motor_lag + d->lag_down, all_lanes(1e-4));
  d->battery = s->battery_nominal + d->battery;
}

/* Voltage of the battery, V: as recorded, or as the drive has it where it was not. */
static inline vd voltage_of(const sample_t *s, const drive_t *d) { return sel(EQ(s->battery, s->battery), s->battery, d->battery); }

/* Force and moment on the body, gravity and gyroscopic terms apart: thrusts, reaction torques, effects. */
static inline void sum_wrench(const sample_t *s, const wrench_t *w, vd force[3], vd moment[3]) {
  for (int k = 0; k < 3; k++) {
    force[k] = w->force[k];
    moment[k] = w->moment[k];
  }
  for (int i = 0; i < ROTORS_OF(s); i++) {
    add_thrust(s, i, s->thrust[i] + w->thrust[i], force, moment);
    add_reaction(s, i, s->torque[i], moment);
  }
}

/* Ground at a point that may lie further away than the features at hand. */
static inline ground_t ground_anywhere(ground_lanes_t *g, vd x, vd y, vd here) {
  vl far = GT(lane_abs(x - here), 0.45 * g->slot);
  if (g->kind != 1 || !any(far)) return ground_at(g, x, y);
  ground_move(g, x);
  ground_t found = ground_at(g, x, y);
  ground_move(g, here);
  return found;
}

/* Distance along body -z to the ground: the plane under the origin, then once more under the point it hits. */
static inline vd range_to_ground(ground_lanes_t *g, const sample_t *s) {
  vd upright = lane_max(s->r[8], all_lanes(0.2));
  vd first = s->agl / upright;
  ground_t hit = ground_anywhere(g, s->p[0] - first * s->r[2], s->p[1] - first * s->r[5], s->p[0]);
  vd range = (s->p[2] - hit.height) / upright;
  return sel(GT(s->r[8], all_lanes(0.2)), range, all_lanes(NAN));
}

static inline void add_readings(const active_t *a, const sample_t *s, vd *y, reading_t *r) {
  memset(r, 0, sizeof *r);
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->sense) a->effect[j]->sense(s, a->p[j], y + Y_X + a->first_state[j], r);
}

#endif
