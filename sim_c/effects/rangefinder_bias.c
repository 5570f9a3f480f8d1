/* Rangefinder with offset and scale error: y = (1 + s) h + b. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  (void)x;
  add->range += p[0] + p[1] * s->range;
}

EFFECT(rangefinder_bias) = {
    .name = "rangefinder_bias",
    .title = "rangefinder offset and scale error",
    .equation = "y = (1 + s) h + b",
    .reference = "definition",
    .channels = "range",
    .kind = GES_SENSOR,
    .n_parameters = 2,
    .parameters = {{"bias_m", "m", "offset", 0.03, 0, -0.3, 0.3}, {"scale", "1", "relative error", 0, 0, -0.2, 0.2}},
    .sense = sense,
};
