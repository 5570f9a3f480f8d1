/* Thrust coefficient, air density or mass off by a constant share, which one flight cannot tell apart: dT_i = s T_i. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) add->thrust[i] += p[0] * s->thrust[i];
}

EFFECT(thrust_scale) = {
    .name = "thrust_scale",
    .title = "thrust per rotor speed off by a constant share (mass, density, thrust coefficient)",
    .equation = "T_i = (1 + s) K_T w_i^2",
    .latex = "T_i = (1 + s)\\, K_T\\, \\Omega_i^2",
    .reference = "definition",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "scale", .unit = "1", .role = GES_AMPLITUDE, .value = 0.05, .neutral = 0, .low = -0.9, .high = 9,
          .doc = "relative change of thrust", .corrects = "mass_kg thrust_coefficient_N_s2", .plausible = 0.25,
          .trim = GES_TRIM_THRUST, .prior = {.shows_in = "any", .step = 0.01, .sd = 0, .flight_sd = 0.01,
                                             /* a cell at 3.5 to 4.2 V, squared */ .unlogged_voltage_sd = 0.1}},
        },
    .about = GES_NOMINAL,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "voltage_or_rotor_speed",
    .rarity = 0.1,
    .wrench = wrench,
};
