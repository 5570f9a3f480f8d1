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
    .reference = "definition",
    .channels = "attitude force_x force_y",
    .kind = GES_SENSOR,
    .n_parameters = 3,
    .parameters = {{"x_rad", "rad", "about body x", 0.01, 0, -0.3, 0.3},
                   {"y_rad", "rad", "about body y", 0, 0, -0.3, 0.3},
                   {"z_rad", "rad", "about body z", 0, 0, -0.3, 0.3}},
    .sense = sense,
};
