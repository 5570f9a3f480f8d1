/* What an effect may read, what it may add, and how it describes itself.
 *
 * An effect is one file that ends in a constant `effect_t`, plus one line in effects.def. It returns increments,
 * which are summed; no effect reads another's output. What several need (thrust out of ground effect, air velocity,
 * height of each rotor) is in the sample, computed once by body/model.h for simulated and recorded states alike.
 * Forces and moments are in the body frame, the moment about the body origin.
 *
 * Order of a step: `adjust` once a flight, then `blow`, `thrust_gain`, `ground`; the thrusts of `ground` over the rotors'
 * own give the ground effect factor, which the firmware may be told; then the firmware, `sense`, `drive`, `wrench`.
 */
#ifndef GES_EFFECT_H
#define GES_EFFECT_H

#include <math.h>

#include "../core/lanes.h"
#include "../core/vmath.h"
#include "../world/terrain.h"
#include "descriptor.h"

/* Units of 4, 6 and 8 rotors that stand upright and are alike have loops of fixed length. That of GES_MAX_ROTORS serves
 * every vehicle: as many rotors as it has, each with its own direction, coefficients and lag. */
#define GES_GENERAL (GES_ROTORS == GES_MAX_ROTORS)
#if GES_GENERAL
#define ROTORS_OF(x) ((x)->rotors)
#else
#define ROTORS_OF(x) ((void)(x), GES_ROTORS)
#endif
#define GES_MAX_STATES (2 * GES_ROTORS) /* extra states of one effect */

typedef struct sample_s sample_t;

/* f - 1 of every rotor near the ground, from a sample and the parameters of the effect whose thrust gain it is. */
typedef void thrust_gain_hook(const sample_t *s, const vd *p, vd thrust_gain[GES_ROTORS]);

struct sample_s {
  vd t, dt;                    /* s; dt: time since the sample before (for readings) */
  vd p[3], v[3];               /* world, m and m/s */
  vd q[4], r[9];               /* attitude; r row-major, body to world */
  vd omega[3];                 /* body, rad/s */
  vd omega_dot[3];             /* body, rad/s^2; that of the step before while simulating */
  vd wind[3], air[3];          /* wind, world; velocity relative to the air, body, m/s */
  vd hub[GES_ROTORS][3], spin[GES_ROTORS], radius[GES_ROTORS];
#if GES_GENERAL
  int rotors;
  vd axis[GES_ROTORS][3], thrust_share[GES_ROTORS], torque_share[GES_ROTORS], inverse_lag_share[GES_ROTORS];
#endif
  vd speed[GES_ROTORS], u[GES_ROTORS];
  vd speed_rate[GES_ROTORS];   /* rad/s^2 */
  vd thrust[GES_ROTORS];       /* K_T w^2, N, out of ground effect */
  vd torque[GES_ROTORS];       /* K_Q w^2, N m, aerodynamic torque of each rotor */
  vd height[GES_ROTORS];       /* rotor hub over the ground, along the world vertical, m */
  grounds_t under;             /* ground below each hub */
  vd thrust_gain[GES_ROTORS];  /* f - 1 of the effect with the hook `thrust_gain` where it is switched on, else 0 */
  vd factor[GES_ROTORS], factor_mean; /* 1 + ground-related thrust increments over thrust */
  ground_t ground;             /* below the body origin */
  vd agl, ground_slope, range, contact;
  vd mass, inertia[3], inverse_mass, inverse_inertia[3], rho, gravity, thrust_coefficient, torque_coefficient, motor_lag, speed_max;
  const ground_lanes_t *map;   /* the ground itself, for effects that look beside the hubs */
  thrust_gain_hook *thrust_gain_at; /* that hook, for what the gain would be elsewhere, or NULL where it is off */
  const vd *thrust_gain_p;     /* and its parameters */
  vd battery, battery_nominal; /* V; NaN where it was not recorded */
  vd voltage;                  /* V; recorded, or as the drive has it; known once the drive is, for `wrench` */
};

typedef struct {
  vd thrust[GES_ROTORS]; /* N, along each rotor axis at its hub */
  vd force[3], moment[3];
} wrench_t;

typedef struct {
  vd speed[GES_ROTORS];            /* rad/s, added to the commanded rotor speed */
  vd lag_up, lag_down;             /* s, added to the motor time constant when speeding up, slowing down */
  vd battery;                      /* V, added to the nominal battery voltage */
} drive_t;

typedef struct {
  vd gyro[3], acc[3], range, attitude[3]; /* attitude: small rotation, body, rad */
  vd rpm[GES_ROTORS], current[GES_ROTORS];
} reading_t;

/* p: the effect's parameters; x: its extra states; dx: their rates (already zero). */
typedef struct {
  GES_EFFECT(GES_FIELD)
  ges_effect_parameter parameters[GES_MAX_PARAMETERS];
  ges_search search[GES_MAX_SEARCHES];
  void (*adjust)(sample_t *s, const vd *p); /* kind parameter: corrects the vehicle's constants */
  void (*begin)(const sample_t *s, const vd *p, vd *x); /* first values of the extra states; default 0 */
  void (*blow)(const sample_t *s, const vd *p, const vd *x, vd wind[3]);
  thrust_gain_hook *thrust_gain; /* at most one of the effects switched on may have it */
  void (*ground)(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add); /* thrust near the ground */
  void (*wrench)(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add);
  void (*drive)(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add);
  void (*sense)(const sample_t *s, const vd *p, vd *x, reading_t *add); /* may advance x by s->dt */
} effect_t;

/* Longest step of extra states along a recording, s. The midpoint rule is stable where |1 + z + z^2/2| <= 1, z the step
 * times a rate: what decays by itself has to take half a step or longer. */
#define GES_STATE_STEP_S 2.5e-3

#define EFFECT(name) const effect_t PER_UNIT(effect_##name)

/* Induced velocity of rotor i hovering at its present thrust, squared, m^2/s^2: T / (2 rho A). */
static inline vd induced_squared(const sample_t *s, int i) {
  return s->thrust[i] / (s->rho * (2.0 * PI) * (s->radius[i] * s->radius[i]));
}
/* Sum over the rotors, pair by pair: the same bits for as many rotors in every unit. */
static inline vd total(const sample_t *s, const vd rotor[GES_ROTORS]) {
  int n = ROTORS_OF(s);
  vd sum = n > 1 ? rotor[0] + rotor[1] : rotor[0];
  for (int i = 2; i + 1 < n; i += 2) sum += rotor[i] + rotor[i + 1];
  return n > 2 && n % 2 ? sum + rotor[n - 1] : sum;
}
static inline vd mean(const sample_t *s, const vd rotor[GES_ROTORS]) { return (1.0 / ROTORS_OF(s)) * total(s, rotor); }
/* Add a thrust along the axis of rotor i, at its hub, to the force and moment on the body. */
static inline void add_thrust(const sample_t *s, int i, vd thrust, vd force[3], vd moment[3]) {
  const vd *r = s->hub[i];
#if GES_GENERAL
  const vd *a = s->axis[i], f[3] = {a[0] * thrust, a[1] * thrust, a[2] * thrust};
  for (int k = 0; k < 3; k++) force[k] += f[k];
  moment[0] += r[1] * f[2] - r[2] * f[1];
  moment[1] += r[2] * f[0] - r[0] * f[2];
  moment[2] += r[0] * f[1] - r[1] * f[0];
#else
  force[2] += thrust;
  moment[0] += r[1] * thrust;
  moment[1] -= r[0] * thrust;
#endif
}
/* Thrusts of all rotors together, body frame, N. */
static inline void thrust_vector(const sample_t *s, vd force[3]) {
#if GES_GENERAL
  vd along[GES_ROTORS];
  for (int k = 0; k < 3; k++) {
    for (int i = 0; i < s->rotors; i++) along[i] = s->axis[i][k] * s->thrust[i];
    force[k] = total(s, along);
  }
#else
  force[0] = force[1] = all_lanes(0.0);
  force[2] = total(s, s->thrust);
#endif
}
/* Add the reaction to an aerodynamic torque of rotor i to the moment on the body. */
static inline void add_reaction(const sample_t *s, int i, vd torque, vd moment[3]) {
#if GES_GENERAL
  for (int k = 0; k < 3; k++) moment[k] -= s->axis[i][k] * (s->spin[i] * torque);
#else
  moment[2] -= s->spin[i] * torque;
#endif
}
/* Velocity of hub i relative to the air, v + omega x r - wind, body frame, m/s: what each rotor meets. */
static inline void hub_air(const sample_t *s, int i, vd air[3]) {
  const vd *w = s->omega, *r = s->hub[i];
  air[0] = s->air[0] + (w[1] * r[2] - w[2] * r[1]);
  air[1] = s->air[1] + (w[2] * r[0] - w[0] * r[2]);
  air[2] = s->air[2] + (w[0] * r[1] - w[1] * r[0]);
}
/* Speed of the air across the disc of rotor i, squared, m^2/s^2. */
static inline vd across_squared(const sample_t *s, int i) {
  vd air[3];
  hub_air(s, i, air);
  return air[0] * air[0] + air[1] * air[1];
}

#endif
