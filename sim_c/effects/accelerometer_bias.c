/* Accelerometer with a constant offset in each body axis. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  (void)s, (void)x;
  for (int k = 0; k < 3; k++) add->acc[k] += p[k];
}

EFFECT(accelerometer_bias) = {
    .name = "accelerometer_bias",
    .title = "constant accelerometer offset",
    .equation = "y = a + b",
    .reference = "definition",
    .channels = "acc",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters = {{"x_m_s2", "m/s^2", "offset, body x", 0.1, 0, -5, 5},
                   {"y_m_s2", "m/s^2", "offset, body y", 0, 0, -5, 5},
                   {"z_m_s2", "m/s^2", "offset, body z", 0, 0, -5, 5}},
    .sense = sense,
};
