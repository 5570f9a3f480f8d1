/* Rotor (induced and flapping) drag: in-plane force against the air velocity, proportional to rotor speed.
 *
 * F_i,xy = -k w_i V_i,xy at the rotor hubs, body frame, V_i = V + omega x r_i. k: 1e-6 (27 g) to 1.2e-4 kg/rad (0.5 kg).
 * Martin & Salaun 2010; Mahony, Kumar & Corke 2012; Faessler et al. 2018. Valid for V well below tip speed. The last lump
 * it at the centre of mass, where it has no moment.
 */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd air[3];
    hub_air(s, i, air);
    vd fx = -p[0] * s->speed[i] * air[0], fy = -p[0] * s->speed[i] * air[1];
    add->force[0] += fx;
    add->force[1] += fy;
    add->moment[0] -= p[1] * (s->hub[i][2] * fy);
    add->moment[1] += p[1] * (s->hub[i][2] * fx);
    add->moment[2] += p[1] * (s->hub[i][0] * fy - s->hub[i][1] * fx);
  }
}

EFFECT(rotor_drag) = {
    .name = "rotor_drag",
    .title = "rotor drag, linear in air speed",
    .equation = "F_i = -k w_i (V + omega x r_i)_xy, M_i = l r_i x F_i",
    .latex = "F_i = -k\\, \\Omega_i\\, (V + \\omega \\times r_i)_{xy},\\; M_i = l\\, r_i \\times F_i",
    .reference = "Mahony, Kumar & Corke 2012; Faessler et al. 2018",
    .channels = "force_x force_y",
    .kind = GES_WRENCH,
    .n_parameters = 2,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_DISSIPATES | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "k_kg", .unit = "kg", .role = GES_AMPLITUDE, .value = 1e-4, .neutral = 0, .low = 0, .high = 1e-2,
          .doc = "force per air speed and rotor speed (kg/rad)", .usual_share = 0.02},
         {.name = "lever", .unit = "1", .role = GES_LEVER, .value = 1, .neutral = NAN, .low = 0, .high = 1,
          .doc = "l, share of the arms of the hubs: 1 where it acts at these, 0 at the centre of mass"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude velocity",
    .hints = GES_OWN_LEVER,
    .family = "drag",
    .wrench = wrench,
};
