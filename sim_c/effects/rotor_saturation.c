/* Rotor speed saturates below its nominal maximum: w_cmd <= s w_max. */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++)
    add->speed[i] -= s->speed_max * lane_max(s->u[i] - p[0], all_lanes(0.0));
}

EFFECT(rotor_saturation) = {
    .name = "rotor_saturation",
    .title = "rotor speed saturates below its nominal maximum",
    .equation = "w_cmd <= s w_max",
    .latex = "\\Omega_\\text{cmd} \\le s\\, \\Omega_\\text{max}",
    .reference = "definition",
    .channels = "drive force_z moment_x moment_y",
    .kind = GES_ACTUATOR,
    .n_parameters = 1,
    .parameters =
        {
         {.name = "share", .unit = "1", .role = GES_AMPLITUDE, .value = 0.8, .neutral = 1, .low = 0.1, .high = 1,
          .doc = "greatest speed over the nominal one"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude",
    .hints = GES_CLIPS,
    .search =
        {
         {.amplitudes = "share", .rule = "asked", .levels = LEVELS(0.1, 0.4, 0.7)},
        },
    .drive = drive,
};
