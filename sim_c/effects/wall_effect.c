/* Attraction to a vertical wall: F = c sum(T) exp(-d/R) towards it, d the distance of the body origin from the wall. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd sine, cosine;
  lane_sin_cos(p[2], &sine, &cosine);
  vd d = lane_max(p[1] - (s->p[0] * cosine + s->p[1] * sine), all_lanes(0.0));
  vd pull = p[0] * total(s->thrust) * lane_exp(-d / s->radius[0]);
  for (int k = 0; k < 3; k++) add->force[k] += pull * (s->r[k] * cosine + s->r[3 + k] * sine);
}

EFFECT(wall_effect) = {
    .name = "wall_effect",
    .title = "attraction to a wall",
    .equation = "F = c sum(T) exp(-d/R) n",
    .reference = "judgement; below 2 % of weight",
    .channels = "force_x force_y",
    .kind = GES_WRENCH,
    .n_parameters = 3,
    .parameters = {{"c", "1", "share of thrust at the wall", 0.02, 0, -0.3, 0.3},
                   {"distance_m", "m", "wall from the world origin along its normal", 2, NAN, -1000, 1000},
                   {"bearing_rad", "rad", "direction of the wall's normal from world x", 0, NAN, -4, 4}},
    .wrench = wrench,
};
