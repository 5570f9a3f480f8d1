/* Reaction torque off by a constant share: dQ_i = s K_Q w_i^2. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < GES_ROTORS; i++) add->moment[2] -= s->spin[i] * (p[0] * s->torque[i]);
}

EFFECT(torque_coefficient) = {
    .name = "torque_coefficient",
    .title = "reaction torque off by a constant share",
    .equation = "Q_i = (1 + s) K_Q w_i^2",
    .reference = "definition",
    .channels = "moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .laws = GES_LAW_FREE_AIR,
    .parameters = {{"scale", "1", "relative change of torque", 0.2, 0, -0.9, 3}},
    .wrench = wrench,
};
