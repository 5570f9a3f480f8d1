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
    .latex = "y = (1 + s)\\, h + b",
    .reference = "definition",
    .channels = "range",
    .kind = GES_SENSOR,
    .n_parameters = 2,
    .parameters =
        {
         {.name = "bias_m", .unit = "m", .role = GES_AMPLITUDE, .value = 0.03, .neutral = 0, .low = -0.3, .high = 0.3,
          .doc = "offset", .prior = {.shows_in = "range", .step = 0.005, .sd = 0.01, .flight_sd = 0.003}},
         {.name = "scale", .unit = "1", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -0.2, .high = 0.2,
          .doc = "relative error", .prior = {.shows_in = "range", .step = 0.01, .sd = 0.02}},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_HEIGHT,
    .needs = "range",
    .search =
        {
         {.amplitudes = "bias_m scale", .rule = "each"},
        },
    .sense = sense,
};
