/* Moments of inertia off by constant shares: I_k = (1 + s_k) I_k,declared. */
#include "effect.h"

static void adjust(sample_t *s, const vd *p) {
  for (int k = 0; k < 3; k++) s->inertia[k] = s->inertia[k] * (1.0 + p[k]);
}

EFFECT(inertia) = {
    .name = "inertia",
    .title = "moments of inertia other than nominal",
    .equation = "I = (1 + s) I_nominal",
    .latex = "I = (1 + s)\\, I_\\text{nominal}",
    .reference = "definition",
    .channels = "moment_x moment_y moment_z",
    .kind = GES_PARAMETER,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "xx", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = -0.7, .high = 3,
          .doc = "relative change about x", .corrects = "inertia_kg_m2.xx", .plausible = 0.3,
          .prior = {.shows_in = "moment_x", .step = 0.02, .sd = 0, .reciprocal = 1}},
         {.name = "yy", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = -0.7, .high = 3,
          .doc = "relative change about y", .corrects = "inertia_kg_m2.yy", .plausible = 0.3,
          .prior = {.shows_in = "moment_y", .step = 0.02, .sd = 0, .reciprocal = 1}},
         {.name = "zz", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = -0.7, .high = 3,
          .doc = "relative change about z", .corrects = "inertia_kg_m2.zz", .plausible = 0.3,
          .prior = {.shows_in = "moment_z", .step = 0.02, .sd = 0, .reciprocal = 1}},
        },
    .about = GES_NOMINAL,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "attitude",
    .rarity = 0.1,
    .search =
        {
         {.amplitudes = "xx yy zz", .rule = "axes", .levels = LEVELS(0.4, -0.3)},
        },
    .adjust = adjust,
};
