/* Climb lowers the blades' incidence: heave damping.
 *
 * dT_i = -k w_i V_i, V_i the air velocity of hub i along its axis (climb positive). With Z_w = k sum(w)/m of 0.3 to
 * 1.2 1/s. Bramwell; Padfield 2007. Out of vortex ring state only: descent below half the induced velocity.
 *
 * Moments: hubs that a roll moves up and down meet an inflow that lags (Pitt & Peters 1981), and a drag along the
 * thrust at the centre makes none. So their coefficient is their own.
 */
#include "effect.h"

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd air[3];
    hub_air(s, i, air);
    add->thrust[i] -= p[0] * s->speed[i] * air[2];
  }
}

EFFECT(axial_inflow) = {
    .name = "axial_inflow",
    .title = "loss of thrust when climbing (heave damping)",
    .equation = "dT_i = -k w_i V_axial,i",
    .latex = "\\Delta T_i = -k\\, \\Omega_i\\, V_{\\text{axial},i}",
    .reference = "Bramwell; Padfield 2007",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_DISSIPATES | GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "k_kg", .unit = "kg", .role = GES_AMPLITUDE, .value = 3e-4, .neutral = 0, .low = 0, .high = 1e-1,
          .doc = "thrust per axial speed and rotor speed (kg/rad)"},
        },
    .about = GES_PHYSICS,
    .hints = GES_OWN_LEVER,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "velocity",
    .wrench = wrench,
};
