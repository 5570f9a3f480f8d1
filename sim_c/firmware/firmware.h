/* Flight firmware: height over ground, velocity and attitude control, mixer, ground effect feedforward.
 *
 * Float only, no allocation, no globals, nothing of the simulator: it can be compiled for a flight controller as it
 * is. Frames and units as in the simulator: world ENU, body FLU, SI.
 */
#ifndef GES_FIRMWARE_H
#define GES_FIRMWARE_H

#include "real.h"

#define FIRMWARE_FEATURES 13 /* gyro[3], range, rpm[4], current[4], thrust_command: the network flies four rotors */

enum {
#define X(name, runs_network, factor, doc) FF_##name,
#include "modes.def"
#undef X
  FF_MODES
};

typedef struct {
  real mass, inertia[3], gravity, thrust_coefficient, speed_max, rotor_radius;
  real thrust_curve; /* c of T = T_max ((1 - c) u^2 + c u) */
  int rotors;                     /* at most FIRMWARE_ROTORS */
  real mixer[FIRMWARE_ROTORS][4]; /* thrust of each rotor per collective thrust and moments x, y, z */
  int allocation;                 /* 0: each command held within its limits; 1: roll and pitch before yaw */
  real altitude_kp, altitude_ki, altitude_kd, altitude_filter, altitude_integral;
  real position_kp, velocity_kp, tangent_max;
  real attitude_kp, attitude_ki, attitude_kd, yaw_kp, yaw_ki, yaw_kd;
  choice height_from_position;
  real mode, mapping, per_rotor, bias, pulse, pulse_start, pulse_end, lead;
  real cutover, trust_band, overprediction_clamp, range_to_rotor;
  choice network_runs;
} fw_config;

/* What the firmware sees at one run. */
typedef struct {
  real t, dt;
  real gyro[3], r[9], p[3], v[3]; /* r: attitude estimate, row-major, body to world */
  real range;                     /* NaN where undefined */
  real rpm[FIRMWARE_ROTORS], current[FIRMWARE_ROTORS];
  real oracle[FIRMWARE_ROTORS];   /* true ground effect factors; a simulator's privilege */
  real p_ref[3], v_ref[3], a_ref[3], heading[2]; /* heading: cosine and sine of the yaw reference */
  real excitation[4];             /* angular acceleration x, y, z (rad/s^2), vertical acceleration (m/s^2) */
} fw_input;

typedef struct {
  real integral, error, slope, range;     /* height loop: integral term, last error, filtered rate, last range */
  real turn[3];                           /* attitude loop: integral terms about x, y, z (rad/s^2) */
  real estimate[FIRMWARE_ROTORS];         /* last feedforward estimates */
  choice started;
} fw_state;

typedef struct {
  real u[FIRMWARE_ROTORS];
  real thrust_command, estimate, shadow;
} fw_output;

/* One run of the whole firmware. */
void firmware_run(const fw_config *c, const fw_input *in, fw_state *state, fw_output *out);

/* Ground effect estimate of every rotor, bias and pulse included; fills out->estimate and out->shadow. */
void ge_ff_estimate(const fw_config *c, const fw_input *in, real range, real thrust_command, fw_state *state,
                    real factor[FIRMWARE_ROTORS], fw_output *out);

/* What the command of a rotor is multiplied with to cancel the factor. */
real ge_ff_scale(const fw_config *c, real factor);

/* Whether a mode of modes.def reads the network. */
choice ge_ff_runs_network(real mode);

/* The exported network. */
real ge_ff_network(const real feature[FIRMWARE_FEATURES]);

/* Whether the network gives, within float rounding, the output stored in its header beside its sample input. */
int ge_ff_network_is_sound(void);

/* Thrust of each rotor per unit of collective thrust and moment: (pseudo-)inverse of what each makes per thrust.
 * effect[0..3][i]: force along z, moments x, y, z of rotor i per its thrust. Returns 0 when the rotors cannot make them. */
int mixer_make(int rotors, float effect[4][FIRMWARE_MAX_ROTORS], float mixer[FIRMWARE_MAX_ROTORS][4]);

#endif
