/* Centre of gravity beside the geometric centre: M = -r x sum(T_i a_i), a_i the axes of the rotors, r the offset, body frame. Hover-like: the
 * terms in angular acceleration (m r x a) are of second order in r and left out. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd thrust[3];
  thrust_vector(s, thrust);
  add->moment[0] -= p[1] * thrust[2];
  add->moment[1] += p[0] * thrust[2];
  add->moment[2] += p[1] * thrust[0] - p[0] * thrust[1];
}

EFFECT(cg_offset) = {
    .name = "cg_offset",
    .title = "centre of gravity beside the centre of the rotors",
    .equation = "M = -r x (sum(T) e_z)",
    .latex = "M = -r \\times \\sum T\\, e_z",
    .reference = "rigid-body statics",
    .channels = "moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "x_m", .unit = "m", .role = GES_AMPLITUDE, .value = 0.005, .neutral = 0, .low = -0.1, .high = 0.1,
          .doc = "offset forward", .whole = 1, .trim = GES_TRIM_LEVER,
          .prior = {.shows_in = "moment", .step = 0.01, .sd = 0.01, .flight_sd = 0.004, .per_arm = 1}},
         {.name = "y_m", .unit = "m", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.1, .high = 0.1,
          .doc = "offset to the left", .whole = 1, .trim = GES_TRIM_LEVER,
          .prior = {.shows_in = "moment", .step = 0.01, .sd = 0.01, .flight_sd = 0.004, .per_arm = 1}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .hints = GES_MANY,
    .search =
        {
         {.amplitudes = "x_m y_m", .rule = "axes"},
        },
    .wrench = wrench,
};
