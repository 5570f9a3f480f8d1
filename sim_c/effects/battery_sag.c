/* Rotor speed falls with battery voltage at fixed command.
 *
 * w_cmd = w_max u [1 + n (V/V_0 - 1)]. V is the recorded voltage where there is one; else
 * V = V_0 - drop t - sag sum(T)/(m g). n = 1 without compensation, 0 with full compensation.
 */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  vd load = total(s->thrust) / (s->mass * s->gravity);
  vd nominal = sel(GT(p[1], all_lanes(0.0)), p[1], s->battery_nominal);
  vd modelled = nominal - p[2] * s->t - p[3] * load;
  vd voltage = sel(MASK(s->battery == s->battery), s->battery, modelled);
  vd change = p[0] * (voltage / nominal - 1.0);
  add->battery += modelled - s->battery_nominal;
  for (int i = 0; i < GES_ROTORS; i++) add->speed[i] += s->speed_max * s->u[i] * change;
}

EFFECT(battery_sag) = {
    .name = "battery_sag",
    .title = "rotor speed falls with battery voltage",
    .equation = "w_cmd = w_max u [1 + n (V/V_0 - 1)]",
    .reference = "first-order motor and battery equations",
    .channels = "drive force_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 4,
    .parameters = {{"sensitivity", "1", "relative speed per relative voltage", 1, 0, 0, 2},
                   {"nominal_V", "V", "voltage at which w_max holds; 0: the vehicle's", 0, NAN, 0, 100},
                   {"drop_V_s", "V/s", "fall of the unloaded voltage", 0.01, NAN, 0, 1},
                   {"load_V", "V", "sag at hover thrust", 0.5, NAN, 0, 10}},
    .drive = drive,
};
