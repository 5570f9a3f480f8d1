/* Height PID, horizontal velocity loop, attitude PD, mixer.
 *
 * Height: a_z = kp e + integral + kd de/dt (filtered), thrust m (g + a_z) / cos(tilt).
 * Attitude: the wanted thrust direction d, seen from the body, asks for angular acceleration
 * kp (-d_y, d_x) + integral - kd omega; yaw by the wanted heading's body component.
 */
#include "firmware.h"

static real dot3(const real a[3], real x, real y, real z) { return a[0] * x + a[1] * y + a[2] * z; }

static real integrated(real integral, real ki, real error, real dt, real most) {
  return within(integral + ki * error * dt, -most, most);
}

/* Filtered PID; the first run starts the filter and holds no memory. */
static real height_acceleration(const fw_config *c, real error, real dt, fw_state *s) {
  real rate = pick(s->started, (error - s->error) / dt, number(0.0f));
  s->slope = s->slope + (rate - s->slope) * (dt / (dt + c->altitude_filter));
  s->error = error;
  s->integral = integrated(s->integral, c->altitude_ki, error, dt, c->altitude_integral);
  s->started = ~(choice){0};
  return c->altitude_kp * error + s->integral + c->altitude_kd * s->slope;
}

static real height_error(const fw_config *c, const fw_input *in, fw_state *s) {
  s->range = pick(WHEN(in->range == in->range), in->range, s->range);
  real over_ground = s->range * in->r[8];
  return in->p_ref[2] - pick(c->height_from_position, in->p[2], over_ground);
}

static void wanted_direction(const fw_config *c, const fw_input *in, real d[3]) {
  for (int k = 0; k < 2; k++)
    d[k] = (in->a_ref[k] + c->velocity_kp * (in->v_ref[k] - in->v[k] + c->position_kp * (in->p_ref[k] - in->p[k]))) /
           c->gravity;
  real length = root(d[0] * d[0] + d[1] * d[1]);
  real shrink = c->tangent_max / greatest(length, c->tangent_max);
  d[0] = d[0] * shrink;
  d[1] = d[1] * shrink;
  real norm = root(1.0f + d[0] * d[0] + d[1] * d[1]);
  d[0] = d[0] / norm;
  d[1] = d[1] / norm;
  d[2] = 1.0f / norm;
}

/* What an error of attitude asks for. The integral is what a lasting moment takes, a weak rotor's or a canted one's. */
static real from_error(real kp, real ki, real error, real dt, real *integral) {
  *integral = integrated(*integral, ki, error, dt, kp);
  return kp * error + *integral;
}

static void wanted_moment(const fw_config *c, const fw_input *in, const real d[3], fw_state *s, real moment[3]) {
  const real *r = in->r;
  real dx = dot3(d, r[0], r[3], r[6]), dy = dot3(d, r[1], r[4], r[7]);
  real yaw_error = in->heading[0] * r[1] + in->heading[1] * r[4];
  real roll = from_error(c->attitude_kp, c->attitude_ki, -dy, in->dt, &s->turn[0]);
  real pitch = from_error(c->attitude_kp, c->attitude_ki, dx, in->dt, &s->turn[1]);
  real yaw = from_error(c->yaw_kp, c->yaw_ki, yaw_error, in->dt, &s->turn[2]);
  moment[0] = c->inertia[0] * (roll - c->attitude_kd * in->gyro[0] + in->excitation[0]);
  moment[1] = c->inertia[1] * (pitch - c->attitude_kd * in->gyro[1] + in->excitation[1]);
  moment[2] = c->inertia[2] * (yaw - c->yaw_kd * in->gyro[2] + in->excitation[2]);
}

static real command_of(const fw_config *c, real thrust) {
  real u = root(greatest(thrust, number(0.0f)) / c->thrust_coefficient) / c->speed_max, share = u * u, k = c->thrust_curve;
  return pick(WHEN(k > 0.0f), 2.0f * share / (k + root(k * k + 4.0f * (1.0f - k) * share)), u);
}

/* How far all rotors have to go along `axis` of the mixer so that the one furthest outside its limits comes in; where some
 * are over and some under, the sum of both, which leaves them equally far outside. */
static real desaturating(const fw_config *c, int axis, const real *rotor, real most) {
  real low = number(0.0f), high = number(0.0f);
  for (int i = 0; i < FIRMWARE_ROTORS_OF(c); i++) {
    real way = c->mixer[i][axis], size = greatest(way, -way), safe = greatest(size, number(1e-6f));
    real past = pick(WHEN(rotor[i] < 0.0f), -rotor[i], pick(WHEN(rotor[i] > most), most - rotor[i], number(0.0f)));
    real gain = pick(WHEN(size > 1e-6f), past / safe * pick(WHEN(way < 0.0f), number(-1.0f), number(1.0f)), number(0.0f));
    low = least(low, gain);
    high = greatest(high, gain);
  }
  return low + high;
}

/* Twice, the second time by half: the first step may push others out. `down`: thrust may fall, never rise. */
static void desaturate(const fw_config *c, int axis, real *rotor, real most, int down) {
  for (int round = 0; round < 2; round++) {
    real gain = desaturating(c, axis, rotor, most) * (round ? 0.5f : 1.0f);
    if (down) gain = least(gain, number(0.0f));
    for (int i = 0; i < FIRMWARE_ROTORS_OF(c); i++) rotor[i] = rotor[i] + gain * c->mixer[i][axis];
  }
}

/* Thrust, roll and pitch first, then as much yaw as is left; after PX4, ControlAllocationSequentialDesaturation.cpp,
 * mixAirmodeDisabled. */
static void allocate(const fw_config *c, real yaw, const real *roll_pitch, real *rotor) {
  real most = c->thrust_coefficient * c->speed_max * c->speed_max;
  for (int i = 0; i < FIRMWARE_ROTORS_OF(c); i++) rotor[i] = roll_pitch[i];
  desaturate(c, 0, rotor, most, 1);
  desaturate(c, 1, rotor, most, 0);
  desaturate(c, 2, rotor, most, 0);
  for (int i = 0; i < FIRMWARE_ROTORS_OF(c); i++) rotor[i] = rotor[i] + yaw * c->mixer[i][3];
  desaturate(c, 3, rotor, 1.15f * most, 0); /* at full thrust some yaw is left, for which thrust falls */
  desaturate(c, 0, rotor, most, 1);
}

void firmware_run(const fw_config *c, const fw_input *in, fw_state *state, fw_output *out) {
  real d[3], moment[3], factor[FIRMWARE_ROTORS];
  real up = height_acceleration(c, height_error(c, in, state), in->dt, state) + in->a_ref[2] + in->excitation[3];
  real thrust = c->mass * greatest(c->gravity + up, number(0.0f)) / greatest(in->r[8], number(0.5f));
  wanted_direction(c, in, d);
  wanted_moment(c, in, d, state, moment);
  out->thrust_command = command_of(c, thrust / (float)FIRMWARE_ROTORS_OF(c));
  ge_ff_estimate(c, in, state->range, out->thrust_command, state, factor, out);
  int rotors = FIRMWARE_ROTORS_OF(c);
  real rotor[FIRMWARE_ROTORS], roll_pitch[FIRMWARE_ROTORS];
  for (int i = 0; i < rotors; i++) {
    const real *m = c->mixer[i];
    roll_pitch[i] = m[0] * thrust + m[1] * moment[0] + m[2] * moment[1];
    rotor[i] = roll_pitch[i] + m[3] * moment[2];
  }
  if (c->allocation) allocate(c, moment[2], roll_pitch, rotor);
  for (int i = 0; i < rotors; i++)
    out->u[i] = within(command_of(c, rotor[i]) * ge_ff_scale(c, factor[i]), number(0.0f), number(1.0f));
}
