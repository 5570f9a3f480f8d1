/* Transport delay of the motor controllers: u(t - d), as Pade's (2, 2) approximation.
 *
 * u_delayed = u - d x2;  x1' = x2,  x2' = (12/d^2)(u - x1) - (6/d) x2, per rotor. For delays below 6 ms the
 * filter keeps 6 ms, so that it is stable at steps up to GES_STATE_STEP_S, and u_delayed = u - delay x2.
 */
#include "effect.h"

static void begin(const sample_t *s, const vd *p, vd *x) {
  (void)p;
  for (int i = 0; i < ROTORS_OF(s); i++) x[i] = s->speed[i] / s->speed_max;
}

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  vd d = lane_max(p[0], all_lanes(0.006)), rate = 1.0 / d;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd late = x[GES_ROTORS + i];
    dx[i] = late;
    dx[GES_ROTORS + i] = (12.0 * rate * rate) * (s->u[i] - x[i]) - (6.0 * rate) * late;
    add->speed[i] -= s->speed_max * (p[0] * late);
  }
}

EFFECT(esc_delay) = {
    .name = "esc_delay",
    .title = "transport delay of the motor controllers",
    .equation = "w_cmd(t) = w_max u(t - d)",
    .latex = "\\Omega_\\text{cmd}(t) = \\Omega_\\text{max}\\, u(t - d)",
    .reference = "Pade approximation",
    .channels = "drive force_z moment_x moment_y moment_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 1,
    .n_states = 2 * GES_ROTORS,
    .parameters =
        {
         {.name = "delay_s", .unit = "s", .role = GES_AMPLITUDE, .value = 0.01, .neutral = 0, .low = 0, .high = 0.1,
          .doc = "delay", .fit_low = 0, .fit_high = 0.06,
          .prior = {.shows_in = "drive", .step = 0.004, .sd = 0.002, .timing = GES_TIMING_DELAY}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "attitude command cause_of_command",
    .family = "lateness of the drive",
    .search =
        {
         {.amplitudes = "delay_s", .rule = "levels", .levels = LEVELS(0.005, 0.012, 0.03)},
        },
    .begin = begin,
    .drive = drive,
};
