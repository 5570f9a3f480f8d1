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
    .latex = "y = \\omega + b",
    .reference = "definition",
    .channels = "gyro",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "x_rad_s", .unit = "rad/s", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = -1, .high = 1,
          .doc = "offset, body x", .prior = {.shows_in = "gyro", .step = 0.001, .sd = 0.0025}},
         {.name = "y_rad_s", .unit = "rad/s", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -1, .high = 1,
          .doc = "offset, body y", .prior = {.shows_in = "gyro", .step = 0.001, .sd = 0.0025}},
         {.name = "z_rad_s", .unit = "rad/s", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -1, .high = 1,
          .doc = "offset, body z", .prior = {.shows_in = "gyro", .step = 0.001, .sd = 0.0025}},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude",
    .settled = "settled before the search, by the attitude's own rate",
    .sense = sense,
};
