/* The thrust gain follows the height with a lag: d(phi)/dt = ((f - 1) - phi) / tau, tau = c (h + R) / v_h.
 * c 0.5 to 5 (Pitt & Peters 1981 give less for pure dynamic inflow). The state phi replaces f - 1. */
#include "effect.h"

static void begin(const sample_t *s, const vd *p, vd *x) {
  (void)p;
  for (int i = 0; i < ROTORS_OF(s); i++) x[i] = s->thrust_gain[i];
}

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  vl on = GT(p[0], all_lanes(0.0));
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd induced = lane_sqrt(lane_max(induced_squared(s, i), all_lanes(1e-6)));
    vd tau = p[0] * (lane_max(s->height[i], all_lanes(0.0)) + s->radius[i]) / induced;
    vd behind = s->thrust_gain[i] - x[i];
    dx[i] = behind / lane_max(tau, all_lanes(2e-3));
    add->thrust[i] -= sel(on, s->thrust[i] * behind, all_lanes(0.0));
  }
}

EFFECT(ground_effect_lag) = {
    .name = "ground_effect_lag",
    .title = "ground effect that builds up with a lag",
    .equation = "tau dphi/dt = (f - 1) - phi, tau = c (h + R)/v_h",
    .latex = "\\tau \\frac{d\\phi}{dt} = (f - 1) - \\phi, \\quad \\tau = c\\, (h + R) / v_h",
    .reference = "Pitt & Peters 1981; Carpenter & Fridovich 1953",
    .modifies = "ground_effect",
    .channels = "force_z",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .n_states = GES_ROTORS,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 1.5, .neutral = 0, .low = 0, .high = 30,
          .doc = "lag in units of (h + R)/v_h"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height",
    .carried = LEVELS(4),
    .search =
        {
         {.amplitudes = "c", .rule = "levels", .levels = LEVELS(0.7, 2, 5)},
        },
    .begin = begin,
    .ground = ground,
};
