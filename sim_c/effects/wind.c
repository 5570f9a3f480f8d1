/* Steady horizontal wind, world frame, with the logarithmic profile near the ground.
 *
 * W(z) = W_10 ln((z + z0)/z0) / ln((10 m + z0)/z0) for z0 > 0, uniform for z0 = 0; z the height over ground.
 * z0 0.01 to 0.1 m over grass. Acts through every effect that reads the air velocity.
 */
#include "effect.h"

static void blow(const sample_t *s, const vd *p, const vd *x, vd wind[3]) {
  (void)x;
  vd profile = all_lanes(1.0);
  vl rough = GT(p[2], all_lanes(0.0));
  if (any(rough)) {
    vd z0 = lane_max(p[2], all_lanes(1e-6)), z = lane_max(s->agl, all_lanes(0.0));
    profile = sel(rough, lane_log(1.0 + z / z0) / lane_log(1.0 + 10.0 / z0), profile);
  }
  wind[0] += p[0] * profile;
  wind[1] += p[1] * profile;
}

EFFECT(wind) = {
    .name = "wind",
    .title = "steady wind",
    .equation = "V_air = v - W(z)",
    .latex = "V_\\text{air} = v - W(z)",
    .reference = "logarithmic boundary-layer profile",
    .channels = "force_x force_y",
    .kind = GES_WIND,
    .n_parameters = 3,
    .parameters =
        {
         {.name = "east_m_s", .unit = "m/s", .role = GES_AMPLITUDE, .value = 2, .neutral = 0, .low = -15, .high = 15,
          .doc = "towards world x, at 10 m"},
         {.name = "north_m_s", .unit = "m/s", .role = GES_AMPLITUDE, .value = 0, .neutral = 0, .low = -15, .high = 15,
          .doc = "towards world y, at 10 m"},
         {.name = "roughness_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = 0, .high = 1,
          .doc = "roughness length; 0: uniform", .usual = 0.03, .usual_sd = 0.03, .fitted = 1,
          .acts_above = {"roughness_m", 0}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude velocity",
    .hints = GES_OWN_LEVER,
    .requires_one_of = "rotor_drag parasitic_drag",
    .search =
        {
         {.amplitudes = "east_m_s north_m_s", .axis = "roughness_m", .levels = LEVELS(0, 0.03)},
        },
    .blow = blow,
};
