/* Spinning rotors resist being turned: M = -omega x H e_z, H = sum_i s_i I_p w_i (counter-clockwise positive). */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd h = all_lanes(0.0);
  for (int i = 0; i < ROTORS_OF(s); i++) h += s->spin[i] * (p[0] * s->speed[i]);
  add->moment[0] -= s->omega[1] * h;
  add->moment[1] += s->omega[0] * h;
}

EFFECT(gyroscopic_moment) = {
    .name = "gyroscopic_moment",
    .title = "gyroscopic moment of the rotors",
    .equation = "M = -omega x sum(s_i I_p w_i) e_z",
    .latex = "M = -\\omega \\times \\sum s_i\\, I_p\\, \\Omega_i\\, e_z",
    .reference = "rigid-body dynamics",
    .channels = "moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_NO_WORK | GES_INVARIANT_FREE_AIR,
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
