/* Speeding a rotor up turns the body the other way: M_z = -sum_i s_i I_p dw_i/dt. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) add_reaction(s, i, p[0] * s->speed_rate[i], add->moment);
}

EFFECT(rotor_inertia_reaction) = {
    .name = "rotor_inertia_reaction",
    .title = "yaw reaction to rotor acceleration",
    .equation = "M_z = -sum(s_i I_p dw_i/dt)",
    .latex = "M_z = -\\sum s_i\\, I_p \\frac{d\\Omega_i}{dt}",
    .reference = "rigid-body dynamics",
    .channels = "moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "inertia_kg_m2", .unit = "kg m^2", .role = GES_AMPLITUDE, .value = 0.0001, .neutral = 0, .low = 0, .high = 0.1,
          .doc = "inertia of one rotor about its axis"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "attitude",
    .wrench = wrench,
};
