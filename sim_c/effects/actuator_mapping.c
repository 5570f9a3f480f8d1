/* Ground effect feedforward applied with the wrong power between what is logged and what the motors get:
 * w_cmd = w_max u f^(-e). e = 1/2: 1/f was applied where 1/sqrt(f) is right. */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd f = lane_max(1.0 + s->thrust_gain[i], all_lanes(0.1));
    add->speed[i] += s->speed_max * s->u[i] * (lane_pow(f, -p[0]) - 1.0);
  }
}

EFFECT(actuator_mapping) = {
    .name = "actuator_mapping",
    .title = "feedforward applied with the wrong power of the ground effect factor",
    .equation = "w_cmd = w_max u f^(-e)",
    .latex = "\\Omega_\\text{cmd} = \\Omega_\\text{max}\\, u\\, f^{-e}",
    .reference = "thrust is quadratic in rotor speed",
    .modifies = "ground_effect",
    .channels = "drive force_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 1,
    .parameters =
        {
         {.name = "exponent", .unit = "1", .role = GES_AMPLITUDE, .value = 0.5, .neutral = 0, .low = -1, .high = 1,
          .doc = "excess exponent; 1/2: 1/f instead of 1/sqrt(f)"},
        },
    .about = GES_NOMINAL,
    .feedback = GES_FEEDBACK_NONE,
    .drive = drive,
};
