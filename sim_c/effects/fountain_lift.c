/* Rotor wakes meet under the body and rise: lift on the body, not on the rotors.
 *
 * dF_z = c_b sum(T) exp(-(h / (c_s d))^2), h the mean height of the hubs, d the distance of neighbouring hubs. Leaves
 * little trace in rotor torque. After Sanchez-Cuevas et al. 2017; the form is a library choice, c_b 0.02 to 0.15.
 */
#include "effect.h"

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd spacing = all_lanes(ROTORS_OF(s) > 1 ? INFINITY : 0.0);
  for (int i = 1; i < ROTORS_OF(s); i++) {
    vd a = s->hub[0][0] - s->hub[i][0], b = s->hub[0][1] - s->hub[i][1], square = a * a + b * b;
    spacing = sel(GT(square, all_lanes(1e-6)), lane_min(spacing, lane_sqrt(square)), spacing); /* not one over the other */
  }
  vd ratio = mean(s, s->height) / (p[1] * lane_max(spacing, all_lanes(1e-3)));
  add->force[2] += p[0] * total(s, s->thrust) * lane_exp(-(ratio * ratio));
}

EFFECT(fountain_lift) = {
    .name = "fountain_lift",
    .title = "lift of the wake fountain on the body",
    .equation = "dF_z = c_b sum(T) exp(-(h/(c_s d))^2)",
    .latex = "\\Delta F_z = c_b \\sum T \\exp(-(h / c_s d)^2)",
    .reference = "Sanchez-Cuevas et al. 2017",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "c_b", .unit = "1", .role = GES_AMPLITUDE, .value = 0.06, .neutral = 0, .low = 0, .high = 0.5,
          .doc = "share of thrust at the ground"},
         {.name = "c_s", .unit = "1", .role = GES_SHAPE, .value = 1, .neutral = NAN, .low = 0.2, .high = 4,
          .doc = "height scale over hub spacing", .usual = 1.5, .usual_sd = 1.0, .fitted = 1},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height",
    .family = "lift near the ground",
    .search =
        {
         {.amplitudes = "c_b", .axis = "c_s", .levels = LEVELS(0.5, 1, 2, 3)},
        },
    .ground = ground,
};
