/* Rotor wakes meet under the body and rise: lift on the body, not on the rotors.
 *
 * dF_z = c_b sum(T) exp(-(h / (c_s d))^2), h the mean height of the hubs, d the distance of neighbouring hubs. Leaves
 * little trace in rotor torque. After Sanchez-Cuevas et al. 2017; the form is a library choice, c_b 0.02 to 0.15.
 */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd a = s->hub[0][0] - s->hub[2][0], b = s->hub[0][1] - s->hub[2][1];
  vd c = s->hub[0][0] - s->hub[3][0], e = s->hub[0][1] - s->hub[3][1];
  vd spacing = lane_min(lane_sqrt(a * a + b * b), lane_sqrt(c * c + e * e));
  vd ratio = 0.25 * total(s->height) / (p[1] * lane_max(spacing, all_lanes(1e-3)));
  add->force[2] += p[0] * total(s->thrust) * lane_exp(-(ratio * ratio));
}

EFFECT(fountain_lift) = {
    .name = "fountain_lift",
    .title = "lift of the wake fountain on the body",
    .equation = "dF_z = c_b sum(T) exp(-(h/(c_s d))^2)",
    .reference = "Sanchez-Cuevas et al. 2017",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .laws = GES_LAW_MIRROR | GES_LAW_FADES,
    .parameters = {{"c_b", "1", "share of thrust at the ground", 0.06, 0, 0, 0.5},
                   {"c_s", "1", "height scale over hub spacing", 1, NAN, 0.2, 4}},
    .wrench = wrench,
};
