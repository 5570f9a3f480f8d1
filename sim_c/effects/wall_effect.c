/* Attraction to a vertical wall: F = c sum(T) exp(-d/R) towards it, d the distance of the body origin from the wall. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd sine, cosine;
  lane_sin_cos(p[2], &sine, &cosine);
  vd d = lane_max(p[1] - (s->p[0] * cosine + s->p[1] * sine), all_lanes(0.0));
  vd pull = p[0] * total(s, s->thrust) * lane_exp(-d / s->radius[0]);
  for (int k = 0; k < 3; k++) add->force[k] += pull * (s->r[k] * cosine + s->r[3 + k] * sine);
}

EFFECT(wall_effect) = {
    .name = "wall_effect",
    .title = "attraction to a wall",
    .equation = "F = c sum(T) exp(-d/R) n",
    .latex = "F = c \\sum T \\exp(-d/R)\\, n",
    .reference = "judgement; below 2 % of weight",
    .channels = "force_x force_y",
    .kind = GES_WRENCH,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = -0.3, .high = 0.3,
          .doc = "share of thrust at the wall"},
         {.name = "distance_m", .unit = "m", .role = GES_SHAPE, .value = 2, .neutral = NAN, .low = -1000, .high = 1000,
          .doc = "wall from the world origin along its normal"},
         {.name = "bearing_rad", .unit = "rad", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -4, .high = 4,
          .doc = "direction of the wall's normal from world x"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude height",
    .rarity = 0.1,
    .search =
        {
         {.amplitudes = "c", .rule = "beside", .axis = "distance_m bearing_rad"},
        },
    .wrench = wrench,
};
