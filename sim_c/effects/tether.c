/* Hose or cable to the ground: its lifted length weighs down, and it pulls when taut.
 *
 * F = -w h e_z, h the height over the anchor; beyond the length L also k (|p - a| - L) towards the anchor a (on the
 * world's z = 0). */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd d[3] = {s->p[0] - p[3], s->p[1] - p[4], s->p[2]}, world[3];
  vd length = lane_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  vd taut = p[1] * lane_max(length - p[2], all_lanes(0.0)) / lane_max(length, all_lanes(1e-6));
  for (int k = 0; k < 3; k++) world[k] = -taut * d[k];
  world[2] -= p[0] * lane_max(s->p[2], all_lanes(0.0));
  for (int k = 0; k < 3; k++) add->force[k] += s->r[k] * world[0] + s->r[3 + k] * world[1] + s->r[6 + k] * world[2];
}

EFFECT(tether) = {
    .name = "tether",
    .title = "cable or hose to the ground",
    .equation = "F = -w h e_z - k max(|d| - L, 0) d/|d|",
    .latex = "F = -w\\, h\\, e_z - k \\max(|d| - L, 0) \\frac{d}{|d|}",
    .reference = "statics",
    .channels = "force_x force_y force_z",
    .kind = GES_WRENCH,
    .n_parameters = 5,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "weight_N_m", .unit = "N/m", .role = GES_AMPLITUDE, .value = 0.1, .neutral = 0, .low = 0, .high = 50,
          .doc = "weight per lifted length"},
         {.name = "stiffness_N_m", .unit = "N/m", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = 0, .high = 1000,
          .doc = "spring when taut"},
         {.name = "length_m", .unit = "m", .role = GES_SWITCH, .value = 3, .neutral = NAN, .low = 0, .high = 1000,
          .doc = "slack length"},
         {.name = "anchor_x_m", .unit = "m", .role = GES_SWITCH, .value = 0, .neutral = NAN, .low = -1000, .high = 1000,
          .doc = "anchor, world x"},
         {.name = "anchor_y_m", .unit = "m", .role = GES_SWITCH, .value = 0, .neutral = NAN, .low = -1000, .high = 1000,
          .doc = "anchor, world y"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "height",
    .search =
        {
         {.amplitudes = "weight_N_m"},
        },
    .wrench = wrench,
};
