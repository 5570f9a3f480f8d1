/* Centre of gravity beside the geometric centre: M = -r x (sum(T) e_z), r the offset, body frame. Hover-like: the
 * terms in angular acceleration (m r x a) are of second order in r and left out. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd thrust = total(s->thrust);
  add->moment[0] -= p[1] * thrust;
  add->moment[1] += p[0] * thrust;
}

EFFECT(cg_offset) = {
    .name = "cg_offset",
    .title = "centre of gravity beside the centre of the rotors",
    .equation = "M = -r x (sum(T) e_z)",
    .reference = "rigid-body statics",
    .channels = "moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .laws = GES_LAW_FREE_AIR,
    .parameters = {{"x_m", "m", "offset forward", 0.005, 0, -0.1, 0.1},
                   {"y_m", "m", "offset to the left", 0, 0, -0.1, 0.1}},
    .wrench = wrench,
};
