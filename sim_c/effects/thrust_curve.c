/* Thrust not quadratic in the command: T = T_max ((1 - c) u^2 + c u), so w_cmd = w_max sqrt((1 - c) u^2 + c u). */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd u = lane_max(s->u[i], all_lanes(0.0));
    vd bent = lane_sqrt(lane_max((1.0 - p[0]) * (u * u) + p[0] * u, all_lanes(0.0)));
    add->speed[i] += s->speed_max * (bent - u);
  }
}

EFFECT(thrust_curve) = {
    .name = "thrust_curve",
    .title = "thrust not quadratic in the command",
    .equation = "T = T_max ((1 - c) u^2 + c u)",
    .latex = "T = T_\\text{max}\\, ((1 - c)\\, u^2 + c\\, u)",
    .reference = "PX4 THR_MDL_FAC (1 - c)",
    .channels = "drive force_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 1,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 0.3, .neutral = 0, .low = -0.5, .high = 1,
          .doc = "linear share", .prior = {.shows_in = "drive command", .step = 0.02, .sd = 0.03}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "command",
    .drive = drive,
};
