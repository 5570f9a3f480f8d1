/* Rotor axes tilted by small angles, body-fixed: F = (d_x, d_y) sum(T), at the hubs. 0.5 to 3 degrees happen. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd fx = p[0] * s->thrust[i], fy = p[1] * s->thrust[i];
    add->force[0] += fx;
    add->force[1] += fy;
    add->moment[0] -= s->hub[i][2] * fy;
    add->moment[1] += s->hub[i][2] * fx;
    add->moment[2] += s->hub[i][0] * fy - s->hub[i][1] * fx;
  }
}

EFFECT(rotor_tilt) = {
    .name = "rotor_tilt",
    .title = "thrust tilted in the body",
    .equation = "F_xy = (d_x, d_y) sum(T)",
    .latex = "F_{xy} = (d_x, d_y) \\sum T",
    .reference = "definition",
    .channels = "force_x force_y",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "x_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = -0.2, .high = 0.2,
          .doc = "tilt towards body x", .whole = 1},
         {.name = "y_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.2, .high = 0.2,
          .doc = "tilt towards body y", .whole = 1},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude",
    .hints = GES_OWN_LEVER,
    .search =
        {
         {.amplitudes = "x_rad y_rad", .rule = "axes"},
        },
    .wrench = wrench,
};
