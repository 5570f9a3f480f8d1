/* Rotors canted about their arms by one small angle, so that their thrust turns the body:
 * F_i = g T_i t_i, M_i = r_i x F_i, with t_i = e_z x r_i / |r_i| across the arm; in yaw g sum(T_i |r_i|).
 *
 * Motors stand straight to a degree or so; of all, the mean counts. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    const vd *r = s->hub[i];
    vd arm = lane_sqrt(r[0] * r[0] + r[1] * r[1]), push = p[0] * s->thrust[i];
    vd fx = -(push * (r[1] / arm)), fy = push * (r[0] / arm);
    add->force[0] += fx;
    add->force[1] += fy;
    add->moment[0] -= r[2] * fy;
    add->moment[1] += r[2] * fx;
    add->moment[2] += push * arm;
  }
}

EFFECT(rotor_cant) = {
    .name = "rotor_cant",
    .title = "rotors canted about their arms: a steady moment in yaw",
    .equation = "F_i = g T_i (e_z x r_i) / |r_i|, M_z = g sum(T_i |r_i|)",
    .latex = "F_i = g\\, T_i \\frac{e_z \\times r_i}{|r_i|}, \\quad M_z = g \\sum T_i\\, |r_i|",
    .reference = "rigid-body statics",
    .channels = "moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "angle_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0.01, .neutral = 0, .low = -0.2, .high = 0.2,
          .doc = "mean angle of the rotors, that turns counter-clockwise seen from above", .trim = GES_TRIM_YAW,
          .prior = {.shows_in = "moment_z", .step = 0.002, .sd = 0}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .wrench = wrench,
};
