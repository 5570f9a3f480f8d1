/* Attitude estimate rotated by a constant small angle about each body axis. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  (void)s, (void)x;
  for (int k = 0; k < 3; k++) add->attitude[k] += p[k];
}

EFFECT(attitude_bias) = {
    .name = "attitude_bias",
    .title = "constant error of the attitude estimate",
    .equation = "R_measured = R (1 + [b]x)",
    .latex = "R_\\text{measured} = R\\, (1 + [b]_\\times)",
    .reference = "definition",
    .channels = "attitude force_x force_y",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "x_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0.01, .neutral = 0, .low = -0.3, .high = 0.3,
          .doc = "about body x", .prior = {.shows_in = "force", .step = 0.002, .sd = 0.006, .flight_sd = 0.003},
          .whole = 1},
         {.name = "y_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.3, .high = 0.3,
          .doc = "about body y", .prior = {.shows_in = "force", .step = 0.002, .sd = 0.006, .flight_sd = 0.003},
          .whole = 1},
         {.name = "z_rad", .unit = "rad", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.3, .high = 0.3,
          .doc = "about body z"},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude",
    .search =
        {
         {.amplitudes = "x_rad y_rad", .rule = "axes"},
        },
    .sense = sense,
};
