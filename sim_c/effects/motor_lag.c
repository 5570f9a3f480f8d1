/* Motors slower than the vehicle file says, speeding up and slowing down: dw/dt = (w_cmd - w)/(tau + d_tau).
 *
 * A lag shorter than one step counts as one step.
 */
#include "effect.h"

static void drive(const sample_t *s, const vd *p, const vd *x, vd *dx, drive_t *add) {
  (void)s, (void)x, (void)dx;
  add->lag_up += p[0];
  add->lag_down += p[1];
}

EFFECT(motor_lag) = {
    .name = "motor_lag",
    .title = "motor lag beyond the declared time constant",
    .equation = "dw/dt = (w_cmd - w) / (tau + d_tau)",
    .latex = "\\frac{d\\Omega}{dt} = \\frac{\\Omega_\\text{cmd} - \\Omega}{\\tau + d_\\tau}",
    .reference = "first-order motor model; no active braking: slower down than up",
    .channels = "drive force_z moment_x moment_y moment_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 2,
    .parameters =
        {
         {.name = "up_s", .unit = "s", .role = GES_AMPLITUDE, .value = 0.03, .neutral = 0, .low = -0.2, .high = 0.5,
          .doc = "added time constant when speeding up", .corrects = "motor_time_constant_s", .fit_low = 0,
          .fit_high = 0.5, .prior = {.shows_in = "drive moment", .step = 0.002, .sd = 0, .timing = GES_TIMING_LAG}},
         {.name = "down_s", .unit = "s", .role = GES_AMPLITUDE, .value = 0.03, .neutral = 0, .low = -0.2, .high = 0.5,
          .doc = "added time constant when slowing down", .corrects = "motor_time_constant_s", .fit_low = 0,
          .fit_high = 0.5, .prior = {.shows_in = "drive moment", .step = 0.002, .sd = 0, .timing = GES_TIMING_LAG}},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_DYNAMIC,
    .needs = "attitude command cause_of_command",
    .family = "lateness of the drive",
    .search =
        {
         {.amplitudes = "up_s down_s", .rule = "slower", .levels = LEVELS(0.25, 1, 3)},
        },
    .drive = drive,
};
