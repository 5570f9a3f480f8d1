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
    .latex = "y = a + b",
    .reference = "definition",
    .channels = "acc",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "x_m_s2", .unit = "m/s^2", .role = GES_AMPLITUDE, .value = 0.1, .neutral = 0, .low = -5, .high = 5,
          .doc = "offset, body x", .prior = {.shows_in = "acc_x", .step = 0.02, .sd = 0.04, .flight_sd = 0.03}},
         {.name = "y_m_s2", .unit = "m/s^2", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -5, .high = 5,
          .doc = "offset, body y", .prior = {.shows_in = "acc_y", .step = 0.02, .sd = 0.04, .flight_sd = 0.03}},
         {.name = "z_m_s2", .unit = "m/s^2", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -5, .high = 5,
          .doc = "offset, body z", .prior = {.shows_in = "acc_z", .step = 0.02, .sd = 0.04, .flight_sd = 0.03}},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "accelerometer",
    .search =
        {
         {.amplitudes = "x_m_s2 y_m_s2 z_m_s2", .rule = "axes"},
        },
    .sense = sense,
};
