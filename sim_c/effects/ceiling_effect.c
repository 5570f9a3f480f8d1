/* Thrust gain below a ceiling: f = 1 / (1 - a (R / 4 z_c)^2), z_c from the hub up to the ceiling, at least 0.3 R.
 * Mirror image of the ground effect with a fitted amplitude; after Sanchez-Cuevas et al. (bridge inspection). */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd room = p[1] - (s->height[i] + s->under.height[i]);
    vd quarter = 0.25 * s->radius[i] / lane_max(room, 0.3 * s->radius[i]);
    vd u = lane_min(p[0] * quarter * quarter, all_lanes(0.8));
    add->thrust[i] += s->thrust[i] * (u / (1.0 - u));
  }
}

EFFECT(ceiling_effect) = {
    .name = "ceiling_effect",
    .title = "thrust gain below a ceiling",
    .equation = "f = 1 / (1 - a (R/4z_c)^2)",
    .latex = "f = \\frac{1}{1 - a\\, (R / 4 z_c)^2}",
    .reference = "Sanchez-Cuevas et al.; Hsiao & Chirarattananon 2019",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_MIRROR,
    .parameters =
        {
         {.name = "amplitude", .unit = "1", .role = GES_AMPLITUDE, .value = 1, .neutral = 0, .low = 0, .high = 12,
          .doc = "scales (R/4z_c)^2", .plausible = 3.0},
         {.name = "ceiling_z_m", .unit = "m", .role = GES_SHAPE, .value = 2.5, .neutral = NAN, .low = -100, .high = 1000,
          .doc = "height of the ceiling, world", .fitted = 1, .reach = 0.5, .reach_over = "radius"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height",
    .rarity = 0.1,
    .search =
        {
         {.amplitudes = "amplitude", .rule = "above", .axis = "ceiling_z_m", .levels = LEVELS(0.5, 1, 2, 4)},
        },
    .wrench = wrench,
};
