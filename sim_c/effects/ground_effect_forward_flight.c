/* Ground effect fades in forward flight: the wake is swept back.
 *
 * dT_i = -T_i (f_i - 1) s / (1 + s),  s = (c V / v_h)^2: the gain becomes (f_i - 1) / (1 + (c V/v_h)^2), with V the
 * speed across the disc and v_h = sqrt(T / (2 rho A)). Form after Cheeseman & Bennett 1955 (c = 1 inside their
 * denominator); c between 0.5 and 2 in the literature. Acts on ground_effect and is nothing without it.
 */
#include "effect.h"

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd v2 = p[0] * p[0] * across_squared(s, i);
    add->thrust[i] -= s->thrust[i] * s->thrust_gain[i] * (v2 / (v2 + lane_max(induced_squared(s, i), all_lanes(1e-9))));
  }
}

EFFECT(ground_effect_forward_flight) = {
    .name = "ground_effect_forward_flight",
    .title = "ground effect that fades in forward flight",
    .equation = "dT_i = -T_i (f_i - 1) (cV)^2 / ((cV)^2 + v_h^2)",
    .latex = "\\Delta T_i = -T_i\\, (f_i - 1) \\frac{(c V)^2}{(c V)^2 + v_h^2}",
    .reference = "Cheeseman & Bennett 1955 (ARC R&M 3021)",
    .modifies = "ground_effect",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 1, .neutral = 0, .low = 0, .high = 10,
          .doc = "speed at which half is gone is v_h / c"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height velocity",
    .carried = LEVELS(1, 2.7),
    .search =
        {
         {.amplitudes = "c", .rule = "levels", .levels = LEVELS(0.4, 1, 2.2, 5)},
        },
    .ground = ground,
};
