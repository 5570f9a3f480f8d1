/* Parasitic drag of the airframe: F = -1/2 rho C_d A |V| V, body frame. C_d A 0.001 (27 g) to 0.03 m^2 (1.5 kg); along thrust
 * it meets the plan of the airframe, which is larger than its front. A body of flat faces is met by the speed against
 * each face alone (the inertia-box model of MuJoCo, "Fluid forces"), a round one by the whole speed. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < 3; i++) {
    vd squares[3];
    for (int k = 0; k < 3; k++) squares[k] = s->air[k] * s->air[k] * (k == i ? all_lanes(1.0) : p[2]);
    vd factor = -0.5 * s->rho * p[0] * lane_sqrt(squares[0] + squares[1] + squares[2]);
    add->force[i] += factor * (i == 2 ? p[1] : all_lanes(1.0)) * s->air[i];
  }
}

EFFECT(parasitic_drag) = {
    .name = "parasitic_drag",
    .title = "parasitic drag of the airframe, quadratic in air speed",
    .equation = "F_i = -1/2 rho C_dA (1, 1, kappa)_i sqrt(V_i^2 + s (|V|^2 - V_i^2)) V_i",
    .latex = "F_i = -\\frac{1}{2}\\, \\rho\\, C_d A\\, (1, 1, \\kappa)_i\\, \\sqrt{V_i^2 + s\\, (|V|^2 - V_i^2)}\\, V_i",
    .reference = "Leishman 2006",
    .channels = "force_x force_y force_z",
    .kind = GES_WRENCH,
    .n_parameters = 3,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_DISSIPATES | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "area_m2", .unit = "m^2", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = 0, .high = 1,
          .doc = "drag area C_d A"},
         {.name = "vertical_ratio", .unit = "1", .role = GES_SHAPE, .value = 1, .neutral = NAN, .low = 0.2, .high = 5,
          .doc = "kappa, drag area along thrust over that across", .usual = 1.0, .usual_sd = 1.0, .fitted = 1},
         {.name = "coupling", .unit = "1", .role = GES_SHAPE, .value = 1, .neutral = NAN, .low = 0, .high = 1,
          .doc = "s, 1 where the whole speed makes the drag of each axis, 0 where its own alone does", .usual = 1.0,
          .usual_sd = 1.0, .fitted = 1},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude velocity",
    .hints = GES_OWN_LEVER,
    .family = "drag",
    .search =
        {
         {.amplitudes = "area_m2", .axis = "vertical_ratio", .levels = LEVELS(1, 1.7)},
         {.amplitudes = "area_m2", .fixed = {{"coupling", 0}}, .axis = "vertical_ratio", .levels = LEVELS(1, 1.7)},
        },
    .wrench = wrench,
};
