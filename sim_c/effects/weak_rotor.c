/* Rotors that give less thrust (and less torque) at the same speed: dT_i = -e_i T_i, dQ_i = -e_i Q_i. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < GES_ROTORS; i++) {
    add->thrust[i] -= p[i] * s->thrust[i];
    add->moment[2] += s->spin[i] * (p[i] * s->torque[i]);
  }
}

EFFECT(weak_rotor) = {
    .name = "weak_rotor",
    .title = "a rotor gives less thrust at the same speed (worn, cut or dirty blade)",
    .equation = "T_i = (1 - e_i) K_T w_i^2",
    .reference = "definition",
    .channels = "force_z moment_x moment_y moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 4,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "loss_1", .unit = "1", .role = GES_AMPLITUDE, .value = 0.15, .neutral = 0, .low = -0.5, .high = 1,
          .doc = "lost share of rotor 1",
          .doubt = {.shows_in = "moment", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}, .trim = GES_TRIM_ROTOR},
         {.name = "loss_2", .unit = "1", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.5, .high = 1,
          .doc = "lost share of rotor 2",
          .doubt = {.shows_in = "moment", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}, .trim = GES_TRIM_ROTOR},
         {.name = "loss_3", .unit = "1", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.5, .high = 1,
          .doc = "lost share of rotor 3",
          .doubt = {.shows_in = "moment", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}, .trim = GES_TRIM_ROTOR},
         {.name = "loss_4", .unit = "1", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.5, .high = 1,
          .doc = "lost share of rotor 4",
          .doubt = {.shows_in = "moment", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}, .trim = GES_TRIM_ROTOR},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_ROTOR,
    .hints = GES_MANY,
    .search =
        {
         {.amplitudes = "loss_1 loss_2 loss_3 loss_4", .rule = "places"},
        },
    .wrench = wrench,
};
