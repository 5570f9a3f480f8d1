/* Wake of another vehicle that hovers at a fixed place above: a push downwards,
 * F = -a (R / 4 dz)^2 exp(-1/2 (d / s)^2) e_z, s = b dz + c, dz and d how far the other is above and beside.
 *
 * a 2267 N, b 0.16, c -0.11 m for a 27 g vehicle (gym-pybullet-drones). There s vanishes at dz = 0.69 m: s is held to at least a
 * rotor radius, and dz too. Nothing acts on a vehicle above the other.
 */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd radius = s->radius[0], away[3] = {s->p[0] - p[3], s->p[1] - p[4], p[5] - s->p[2]};
  vd below = lane_max(away[2], radius), width = lane_max(p[1] * below + p[2], radius), quarter = 0.25 * radius / below;
  vd off = (away[0] * away[0] + away[1] * away[1]) / (width * width);
  vd push = p[0] * quarter * quarter * lane_exp(-0.5 * off);
  push = sel(GT(away[2], all_lanes(0.0)), push, all_lanes(0.0));
  for (int k = 0; k < 3; k++) add->force[k] -= push * s->r[6 + k];
}

EFFECT(downwash) = {
    .name = "downwash",
    .title = "downwash of another vehicle above",
    .equation = "F = -a (R/4dz)^2 exp(-1/2 (d/(b dz + c))^2) e_z",
    .latex = "F = -a\\, (R / 4 \\Delta z)^2 \\exp\\left(-\\frac{1}{2} \\left(\\frac{d}{b\\, \\Delta z + "
             "c}\\right)^2\\right) e_z",
    .reference = "gym-pybullet-drones (Panerati et al. 2021)",
    .channels = "force_x force_y force_z",
    .kind = GES_WRENCH,
    .n_parameters = 6,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "force_N", .unit = "N", .role = GES_AMPLITUDE, .value = 2267.18, .neutral = 0, .low = 0, .high = 1e6,
          .doc = "push where dz is a quarter radius"},
         {.name = "spread", .unit = "1", .role = GES_SHAPE, .value = 0.16, .neutral = NAN, .low = 0, .high = 2,
          .doc = "growth of the wake's width with distance"},
         {.name = "width_m", .unit = "m", .role = GES_SHAPE, .value = -0.11, .neutral = NAN, .low = -1, .high = 2,
          .doc = "width at the other vehicle, extrapolated", .fitted = 1, .reach = 0.5, .reach_over = "width_m"},
         {.name = "other_x_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1e4, .high = 1e4,
          .doc = "other vehicle, world x", .fitted = 1, .reach = 0.5, .reach_over = "width_m"},
         {.name = "other_y_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1e4, .high = 1e4,
          .doc = "other vehicle, world y", .fitted = 1, .reach = 0.5, .reach_over = "width_m"},
         {.name = "other_z_m", .unit = "m", .role = GES_SHAPE, .value = 2, .neutral = NAN, .low = -1e4, .high = 1e4,
          .doc = "other vehicle, world z"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "height",
    .rarity = 0.1,
    .search =
        {
         {.amplitudes = "force_N", .rule = "over_places", .levels = LEVELS(5), .fixed = {{"spread", 0}},
          .axis = "other_x_m other_y_m other_z_m width_m"},
        },
    .wrench = wrench,
};
