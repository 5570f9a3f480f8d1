/* Moment of the thrust gains beyond (or short of) what their thrusts make: dM = q sum(r_i x T_i (f_i - 1) e_z).
 * q = -1 cancels the levelling moment, q < -1 flips it (fountain). Yang et al. 2025. */
#include "effect.h"

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd lift = p[0] * s->thrust[i] * s->thrust_gain[i];
    add->moment[0] += s->hub[i][1] * lift;
    add->moment[1] -= s->hub[i][0] * lift;
  }
}

EFFECT(ground_effect_moment) = {
    .name = "ground_effect_moment",
    .title = "levelling moment near the ground beyond that of the thrusts",
    .equation = "dM = q sum(r_i x T_i (f_i - 1) e_z)",
    .latex = "\\Delta M = q \\sum r_i \\times T_i\\, (f_i - 1)\\, e_z",
    .reference = "Yang et al. 2025",
    .modifies = "ground_effect",
    .channels = "moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "q", .unit = "1", .role = GES_AMPLITUDE, .value = 0.5, .neutral = 0, .low = -10, .high = 10,
          .doc = "excess over the moment of the thrusts",
          .prior = {.shows_in = "moment", .step = 0.1, .sd = 0.25, .mean = -0.35}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "height",
    .hints = GES_LEVER_OF_CARRIER,
    .carried = LEVELS(-0.5, 0, 0.5, 4),
    .ground = ground,
};
