/* Rotors that give less thrust (and less torque) at the same speed: dT_i = -e_i T_i, dQ_i = -e_i Q_i. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    add->thrust[i] -= p[i] * s->thrust[i];
    add_reaction(s, i, -(p[i] * s->torque[i]), add->moment);
  }
}

#define LOSS(i) \
  {.name = "loss_" #i, .unit = "1", .role = GES_AMPLITUDE, .value = i == 1 ? 0.15 : 0, .neutral = 0, .low = -0.5, .high = 1, \
   .doc = "lost share of rotor " #i, .rotor = i, .trim = GES_TRIM_ROTOR, \
   .prior = {.shows_in = "moment", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}},

EFFECT(weak_rotor) = {
    .name = "weak_rotor",
    .title = "a rotor gives less thrust at the same speed (worn, cut or dirty blade)",
    .equation = "T_i = (1 - e_i) K_T w_i^2",
    .latex = "T_i = (1 - e_i)\\, K_T\\, \\Omega_i^2",
    .reference = "definition",
    .channels = "force_z moment_x moment_y moment_z",
    .kind = GES_WRENCH,
    .n_parameters = GES_MAX_ROTORS,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         EACH_ROTOR(LOSS)
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_ROTOR,
    .hints = GES_MANY,
    .search =
        {
         {.amplitudes = "loss_*", .rule = "places"},
        },
    .wrench = wrench,
};
