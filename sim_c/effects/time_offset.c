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
    .reference = "first-order expansion",
    .channels = "gyro attitude",
    .kind = GES_SENSOR,
    .n_parameters = 1,
    .parameters = {{"delay_s", "s", "delay", 0.02, 0, -0.1, 0.1}},
    .sense = sense,
};
