/* Parasitic drag of the airframe: F = -1/2 rho C_d A |V| V, body frame. C_d A 0.001 (27 g) to 0.03 m^2 (1.5 kg); along thrust
 * it meets the plan of the airframe, which is larger than its front. */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  vd speed = lane_sqrt(s->air[0] * s->air[0] + s->air[1] * s->air[1] + s->air[2] * s->air[2]);
  vd factor = -0.5 * s->rho * p[0] * speed;
  add->force[0] += factor * s->air[0];
  add->force[1] += factor * s->air[1];
  add->force[2] += factor * p[1] * s->air[2];
}

EFFECT(parasitic_drag) = {
    .name = "parasitic_drag",
    .title = "parasitic drag of the airframe, quadratic in air speed",
    .equation = "F = -1/2 rho C_dA |V| (V_x, V_y, kappa V_z)",
    .latex = "F = -\\frac{1}{2}\\, \\rho\\, C_d A\\, |V|\\, (V_x, V_y, \\kappa V_z)",
    .reference = "Leishman 2006",
    .channels = "force_x force_y force_z",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_DISSIPATES | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "area_m2", .unit = "m^2", .role = GES_AMPLITUDE, .value = 0.02, .neutral = 0, .low = 0, .high = 1,
          .doc = "drag area C_d A"},
         {.name = "vertical_ratio", .unit = "1", .role = GES_SHAPE, .value = 1, .neutral = NAN, .low = 0.2, .high = 5,
          .doc = "kappa, drag area along thrust over that across", .usual = 1.0, .usual_sd = 1.0, .fitted = 1},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude velocity",
    .hints = GES_OWN_LEVER,
    .family = "drag",
    .search =
        {
         {.amplitudes = "area_m2", .axis = "vertical_ratio", .levels = LEVELS(1, 1.7)},
        },
    .wrench = wrench,
};
