/* Attitude and gyro late against the other streams by a constant time, to first order:
 * omega(t - d) = omega - d omega', attitude turned back by d omega. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  (void)x;
  for (int k = 0; k < 3; k++) {
    add->gyro[k] -= p[0] * s->omega_dot[k];
    add->attitude[k] -= p[0] * s->omega[k];
  }
}

EFFECT(time_offset) = {
    .name = "time_offset",
    .title = "attitude and gyro late against the other streams",
    .equation = "y(t) = x(t - d)",
    .latex = "y(t) = x(t - d)",
    .reference = "first-order expansion",
    .channels = "gyro attitude",
    .kind = GES_SENSOR,
    .n_parameters = 1,
    .parameters =
        {
         {.name = "delay_s", .unit = "s", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = -0.1, .high = 0.1,
          .doc = "delay", .prior = {.shows_in = "moment", .step = 0.001, .sd = 0.003}},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude",
    .settled = "settled before the search, by the delay between streams",
    .sense = sense,
};
