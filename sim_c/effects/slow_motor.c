/* Motors that turn slower than the others at the same command: w_cmd,i = w_max u_i (1 - e_i + mean(e)).
 *
 * What all motors lack is no motor's: it is the top speed, or the battery.
 */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  vd all = mean(s, p);
  for (int i = 0; i < ROTORS_OF(s); i++) add->speed[i] -= s->speed_max * s->u[i] * (p[i] - all);
}

#define LOSS(i) \
  {.name = "loss_" #i, .unit = "1", .role = GES_AMPLITUDE, .value = i == 1 ? 0.05 : 0, .neutral = 0, .low = -0.5, .high = 1, \
   .doc = "share of its speed that motor " #i " lacks, beyond all others", .rotor = i, \
   .prior = {.shows_in = "drive", .step = 0.0025, .sd = 0.005}},

EFFECT(slow_motor) = {
    .name = "slow_motor",
    .title = "a motor turns slower at the same command (worn bearing, bad speed controller)",
    .equation = "w_cmd = w_max u (1 - e_i + sum_j e_j / n)",
    .latex = "\\Omega_\\text{cmd} = \\Omega_\\text{max}\\, u\\, (1 - e_i + \\sum_j e_j / n)",
    .reference = "definition",
    .channels = "drive",
    .kind = GES_ACTUATOR,
    .n_parameters = GES_MAX_ROTORS,
    .parameters =
        {
         EACH_ROTOR(LOSS)
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "command rotor_speed",
    .hints = GES_MANY,
    .search =
        {
         {.amplitudes = "loss_*", .rule = "places"},
        },
    .drive = drive,
};
