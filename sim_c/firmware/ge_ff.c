/* Ground effect feedforward: estimate the factor f by which thrust grows near the ground, and scale the command.
 *
 * Thrust is quadratic in rotor speed and rotor speed linear in the command, so f is cancelled by 1/sqrt(f); 1/f is
 * the historical error, kept selectable. The modes are the rows of modes.def.
 */
#include "firmware.h"
#include <ge_ff_mlp_weights.h>

_Static_assert(GES_MLP_IN == FIRMWARE_FEATURES, "the network's inputs are the firmware's 13 features");

static real analytical(const fw_config *c, real clearance) {
  real quarter = 0.25f * c->rotor_radius / greatest(clearance, 0.26f * c->rotor_radius);
  return within(1.0f / (1.0f - quarter * quarter), number(0.5f), number(1.8f));
}

static void layer(const float *weight, const float *bias, int n_in, int n_out, const real *in, real *out) {
  for (int j = 0; j < n_out; j++) {
    real sum = number(bias[j]);
    for (int i = 0; i < n_in; i++) sum = sum + weight[j * n_in + i] * in[i];
    out[j] = sum;
  }
}

static void rectify(real *x, int n) {
  for (int i = 0; i < n; i++) x[i] = greatest(x[i], number(0.0f));
}

real ge_ff_network(const real feature[FIRMWARE_FEATURES]) {
  real in[GES_MLP_IN], hidden1[GES_MLP_HIDDEN1], hidden2[GES_MLP_HIDDEN2], out[1];
  for (int i = 0; i < GES_MLP_IN; i++) in[i] = (feature[i] - ges_mlp_mean[i]) / ges_mlp_scale[i];
  layer(ges_mlp_w1, ges_mlp_b1, GES_MLP_IN, GES_MLP_HIDDEN1, in, hidden1);
  rectify(hidden1, GES_MLP_HIDDEN1);
  layer(ges_mlp_w2, ges_mlp_b2, GES_MLP_HIDDEN1, GES_MLP_HIDDEN2, hidden1, hidden2);
  rectify(hidden2, GES_MLP_HIDDEN2);
  layer(ges_mlp_w3, ges_mlp_b3, GES_MLP_HIDDEN2, 1, hidden2, out);
  return out[0] * ges_mlp_out_scale + ges_mlp_out_mean;
}

int ge_ff_network_is_sound(void) {
  real feature[FIRMWARE_FEATURES];
  for (int i = 0; i < FIRMWARE_FEATURES; i++) feature[i] = number(ges_mlp_sample_in[i]);
  real off = ge_ff_network(feature) - ges_mlp_sample_out;
  return !some(WHEN(off * off > 1e-10f) | WHEN(off != off));
}

#if FIRMWARE_ROTORS == 4
static real run_network(const fw_config *c, const fw_input *in, real range, real thrust_command) {
  if (!some(c->network_runs)) return number(__builtin_nanf(""));
  real feature[FIRMWARE_FEATURES] = {in->gyro[0], in->gyro[1], in->gyro[2], range};
  for (int i = 0; i < 4; i++) {
    feature[4 + i] = in->rpm[i];
    feature[8 + i] = in->current[i];
  }
  feature[12] = thrust_command;
  return pick(c->network_runs, ge_ff_network(feature), number(__builtin_nanf("")));
}

#else
static real run_network(const fw_config *c, const fw_input *in, real range, real thrust_command) {
  (void)c, (void)in, (void)range, (void)thrust_command;
  return number(__builtin_nanf(""));
}
#endif

choice ge_ff_runs_network(real mode) {
  choice runs = {0};
#define X(name, runs_network, factor, doc) \
  if (runs_network) runs = runs | WHEN(mode == (float)FF_##name);
#include "modes.def"
#undef X
  return runs;
}

static real rotor_factor(const fw_config *c, real network, real model, real oracle, real range) {
  real distance = greatest(network - model, model - network);
  choice trusted = WHEN(range >= c->cutover) & WHEN(distance <= c->trust_band);
  real f = number(1.0f);
#define X(name, runs_network, factor, doc) f = pick(WHEN(c->mode == (float)FF_##name), factor, f);
#include "modes.def"
#undef X
  return f;
}

/* Advance the estimate by the lead time through its own rate of change. */
static real lead(const fw_config *c, real f, real last, real dt) {
  return pick(WHEN(c->lead > 0.0f) & WHEN(last > 0.0f), f + c->lead * (f - last) / dt, f);
}

/* Pair by pair, as the simulator sums. */
static real total_of(int n, const real *rotor) {
  real sum = n > 1 ? rotor[0] + rotor[1] : rotor[0];
  for (int i = 2; i + 1 < n; i += 2) sum = sum + (rotor[i] + rotor[i + 1]);
  return n > 2 && n % 2 ? sum + rotor[n - 1] : sum;
}

void ge_ff_estimate(const fw_config *c, const fw_input *in, real range, real thrust_command, fw_state *state,
                    real factor[FIRMWARE_ROTORS], fw_output *out) {
  real network = run_network(c, in, range, thrust_command);
  real model = analytical(c, range * in->r[8] + c->range_to_rotor);
  int rotors = FIRMWARE_ROTORS_OF(c);
  float share = 1.0f / (float)rotors;
  real mean = share * total_of(rotors, in->oracle);
  choice in_pulse = WHEN(in->t >= c->pulse_start) & WHEN(in->t < c->pulse_end);
  real bias = c->bias + pick(in_pulse, c->pulse, number(0.0f));
  out->estimate = number(0.0f);
  for (int i = 0; i < rotors; i++) {
    real oracle = pick(WHEN(c->per_rotor > 0.5f), in->oracle[i], mean);
    real f = rotor_factor(c, network, model, oracle, range) + bias;
    factor[i] = greatest(lead(c, f, state->estimate[i], in->dt), number(0.1f));
    state->estimate[i] = f;
    out->estimate = out->estimate + share * factor[i];
  }
  out->shadow = network;
}

real ge_ff_scale(const fw_config *c, real factor) {
  return pick(WHEN(c->mapping > 0.5f), 1.0f / factor, 1.0f / root(factor));
}
