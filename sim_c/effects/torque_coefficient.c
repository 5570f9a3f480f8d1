/* Reaction torque off by a constant share: dQ_i = s K_Q w_i^2. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) add_reaction(s, i, p[0] * s->torque[i], add->moment);
}

EFFECT(torque_coefficient) = {
    .name = "torque_coefficient",
    .title = "reaction torque off by a constant share",
    .equation = "Q_i = (1 + s) K_Q w_i^2",
    .latex = "Q_i = (1 + s)\\, K_Q\\, \\Omega_i^2",
    .reference = "definition",
    .channels = "moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "scale", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = -0.9, .high = 3,
          .doc = "relative change of torque", .corrects = "torque_coefficient_Nm_s2", .plausible = 0.3,
          .prior = {.shows_in = "moment_z", .step = 0.02, .sd = 0}},
        },
    .about = GES_NOMINAL,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "attitude",
    .rarity = 0.1,
    .wrench = wrench,
};
