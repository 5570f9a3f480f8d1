/* Rotor speed falls with battery voltage at fixed command.
 *
 * w_cmd = w_max u [1 + n (V/V_0 - 1)]. V is the recorded voltage where there is one; else
 * V = V_0 - drop t - sag sum(T)/(m g). n = 1 without compensation, 0 with full compensation.
 */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  vd load = total(s, s->thrust) / (s->mass * s->gravity);
  vd nominal = sel(GT(p[1], all_lanes(0.0)), p[1], s->battery_nominal);
  vd modelled = nominal - p[2] * s->t - p[3] * load;
  vd voltage = sel(EQ(s->battery, s->battery), s->battery, modelled);
  vd change = p[0] * (voltage / nominal - 1.0);
  add->battery += modelled - s->battery_nominal;
  for (int i = 0; i < ROTORS_OF(s); i++) add->speed[i] += s->speed_max * s->u[i] * change;
}

EFFECT(battery_sag) = {
    .name = "battery_sag",
    .title = "rotor speed falls with battery voltage",
    .equation = "w_cmd = w_max u [1 + n (V/V_0 - 1)]",
    .latex = "\\Omega_\\text{cmd} = \\Omega_\\text{max}\\, u\\, [1 + n (V/V_0 - 1)]",
    .reference = "first-order motor and battery equations",
    .channels = "drive force_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 4,
    .parameters =
        {
         {.name = "sensitivity", .unit = "1", .role = GES_AMPLITUDE, .value = 1, .neutral = 0, .low = 0, .high = 2,
          .doc = "relative speed per relative voltage",
          .prior = {.shows_in = "drive", .step = 0.02, .sd = 0.04, .with_voltage = 1}},
         {.name = "nominal_V", .unit = "V", .role = GES_SWITCH, .value = 0, .neutral = NAN, .low = 0, .high = 100,
          .doc = "voltage at which w_max holds; 0: the vehicle's"},
         {.name = "drop_V_s", .unit = "V/s", .role = GES_SWITCH, .value = 0.01, .neutral = NAN, .low = 0, .high = 1,
          .doc = "fall of the unloaded voltage", .prior = {.shows_in = "drive", .step = 0.002, .unlogged_voltage_sd = 0.03}},
         {.name = "load_V", .unit = "V", .role = GES_SWITCH, .value = 0.5, .neutral = NAN, .low = 0, .high = 10,
          .doc = "sag at hover thrust", .prior = {.shows_in = "drive", .step = 0.1, .unlogged_voltage_sd = 0.5}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "voltage",
    .hints = GES_READS_VOLTAGE,
    .search =
        {
         {.amplitudes = "sensitivity"},
        },
    .drive = drive,
};
