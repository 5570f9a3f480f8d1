/* The lower rotor of a coaxial pair flies in the wake of the upper one, and gives less thrust at the same speed.
 *
 *   dT_l = -c K_T w_l w_u A / (pi R_w^2),  A of circles R_w and R, e = |hub_l - hub_u + t V| apart, across
 *
 * A rotor in an axial flow loses thrust in proportion to its speed times the flow. That of the wake is
 * pi R^2 v = pi R_w^2 s v, v = sqrt(T_u / (2 rho pi R^2)): however far below, d. A: of the wake what meets the lower disc.
 * The wake speeds up from v to 2 v, s = 1 at the disc and 2 far below it (Leishman 2006, 2.15.1). Flying across at V
 * carries it aside by t V, t = d / ((1 + s) v / 2). c: .2 to .3 (Coleman 1997, NASA TP-3675; Leishman and Ananthan
 * 2006). */
#include "effect.h"

/* Of a circle of radius r, the part that lies in one of radius 1 whose centre is e away. */
static vd shared(vd r, vd e) {
  e = lane_max(e, all_lanes(1e-9));
  vd e2 = e * e, r2 = r * r;
  vd kite = (1.0 + r - e) * (e + r - 1.0) * (e - r + 1.0) * (e + r + 1.0);
  vd area = r2 * lane_acos((e2 + r2 - 1.0) / (2.0 * e * r)) + lane_acos((e2 + 1.0 - r2) / (2.0 * e)) -
            0.5 * lane_sqrt(lane_max(kite, all_lanes(0.0)));
  return area / (PI * r2);
}

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int l = 0; l < ROTORS_OF(s); l++)
    for (int u = 0; u < ROTORS_OF(s); u++) {
      if (u == l) continue;
      const vd *low = s->hub[l], *up = s->hub[u];
      vd a = low[0] - up[0], b = low[1] - up[1], below = up[2] - low[2], radius = s->radius[l];
      vl over = GT(below, all_lanes(0.0)) & GT(radius * radius, a * a + b * b);
      if (!any(over)) continue;
      vd slowest = lane_sqrt(lane_max(induced_squared(s, u), all_lanes(1e-6)));
      vd time = below / (0.5 * (1.0 + p[1]) * slowest), wake = s->radius[u] / lane_sqrt(p[1]);
      vd beside = a + time * s->air[0], across = b + time * s->air[1];
      vd share = shared(wake / radius, lane_sqrt(beside * beside + across * across) / radius);
      vd lost = p[0] * share * lane_sqrt(s->thrust[l] * s->thrust[u]);
      add->thrust[l] -= sel(over, lost, all_lanes(0.0));
    }
}

EFFECT(coaxial_wake) = {
    .name = "coaxial_wake",
    .title = "the lower rotor of a coaxial pair flies in the upper one's wake",
    .equation = "dT_l = -c K_T w_l w_u A / (pi R_w^2)",
    .latex = "\\Delta T_l = -c\\, K_T\\, \\Omega_l\\, \\Omega_u \\frac{A}{\\pi R_w^2}",
    .reference = "Leishman 2006; Coleman 1997",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "c", .unit = "1", .role = GES_AMPLITUDE, .value = 0.2, .neutral = 0, .low = 0, .high = 0.8,
          .doc = "lost share of the lower rotor, where both turn alike and hover", .plausible = 0.3},
         {.name = "speed_ratio", .unit = "1", .role = GES_SHAPE, .value = 1.5, .neutral = NAN, .low = 1, .high = 2,
          .doc = "s, speed of the wake at the lower rotor over that at the upper", .usual = 1.5, .usual_sd = 0.3,
          .fitted = 1},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .search =
        {
         {.amplitudes = "c", .rule = "coaxial", .axis = "speed_ratio", .levels = LEVELS(1, 1.5, 2)},
        },
    .wrench = wrench,
};
