/* The lower rotor of a coaxial pair flies in the wake of the upper one, and gives less thrust at the same speed.
 *
 *   dT_l = -c K_T w_l w_u exp(-(e / R)^2),  e = |hub_l - hub_u - (d / 2 v_u) V|, across
 *
 * Momentum theory (Leishman 2006, 2.15.1): below a rotor the wake speeds up and contracts so that the flow through it
 * stays A v_u, v_u = sqrt(T_u / (2 rho A)): how far below it, d, does not matter. A rotor in an axial flow loses thrust in
 * proportion to its speed times the flow, and v_u goes with w_u. Flying across at V carries the wake aside by V d over
 * its speed, some 2 v_u: e is how far beside the lower hub its middle then passes. c: .2 to .3 (Coleman 1997, NASA
 * TP-3675; Leishman and Ananthan 2006). */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int l = 0; l < ROTORS_OF(s); l++)
    for (int u = 0; u < ROTORS_OF(s); u++) {
      if (u == l) continue;
      const vd *low = s->hub[l], *up = s->hub[u];
      vd a = low[0] - up[0], b = low[1] - up[1], below = up[2] - low[2], radius = s->radius[l];
      vl over = GT(below, all_lanes(0.0)) & GT(radius * radius, a * a + b * b);
      if (!any(over)) continue;
      vd wake = 2.0 * lane_sqrt(lane_max(induced_squared(s, u), all_lanes(1e-6)));
      vd beside = a + below * (s->air[0] / wake), across = b + below * (s->air[1] / wake);
      vd share = lane_exp(-(beside * beside + across * across) / (radius * radius));
      vd lost = p[0] * share * lane_sqrt(s->thrust[l] * s->thrust[u]);
      add->thrust[l] -= sel(over, lost, all_lanes(0.0));
    }
}

EFFECT(coaxial_wake) = {
    .name = "coaxial_wake",
    .title = "the lower rotor of a coaxial pair flies in the upper one's wake",
    .equation = "dT_l = -c K_T w_l w_u exp(-(e/R)^2)",
    .latex = "\\Delta T_l = -c\\, K_T\\, \\Omega_l\\, \\Omega_u \\exp(-(e/R)^2)",
    .reference = "Leishman 2006; Coleman 1997",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = 0, .high = 0.8,
          .doc = "lost share of the lower rotor, where both turn alike and hover", .plausible = 0.3},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .search =
        {
         {.amplitudes = "c", .rule = "coaxial"},
        },
    .wrench = wrench,
};
