/* Extra thrust with edgewise speed, at any height: dT_i = c T_i V^2 / (V^2 + v_h^2), V across the disc, of its hub. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd v2 = across_squared(s, i);
    add->thrust[i] += p[0] * s->thrust[i] * (v2 / (v2 + lane_max(induced_squared(s, i), all_lanes(1e-9))));
  }
}

EFFECT(translational_lift) = {
    .name = "translational_lift",
    .title = "extra thrust with edgewise speed",
    .equation = "dT_i = c T_i V^2 / (V^2 + v_h^2)",
    .latex = "\\Delta T_i = c\\, T_i \\frac{V^2}{V^2 + v_h^2}",
    .reference = "Leishman 2006",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 0.3, .neutral = 0, .low = 0, .high = 3,
          .doc = "share of thrust gained at high speed"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "velocity",
    .wrench = wrench,
};
