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
    .reference = "first-order motor model; no active braking: slower down than up",
    .channels = "drive force_z moment_x moment_y moment_z",
    .kind = GES_ACTUATOR,
    .n_parameters = 2,
    .parameters = {{"up_s", "s", "added time constant when speeding up", 0.03, 0, -0.2, 0.5},
                   {"down_s", "s", "added time constant when slowing down", 0.03, 0, -0.2, 0.5}},
    .drive = drive,
};
