/* Gyro with a constant offset in each body axis. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  (void)s, (void)x;
  for (int k = 0; k < 3; k++) add->gyro[k] += p[k];
}

EFFECT(gyro_bias) = {
    .name = "gyro_bias",
    .title = "constant gyro offset",
    .equation = "y = omega + b",
    .reference = "definition",
    .channels = "gyro",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters = {{"x_rad_s", "rad/s", "offset, body x", 0.02, 0, -1, 1},
                   {"y_rad_s", "rad/s", "offset, body y", 0, 0, -1, 1},
                   {"z_rad_s", "rad/s", "offset, body z", 0, 0, -1, 1}},
    .sense = sense,
};
