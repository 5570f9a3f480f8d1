/* A mass fixed to the body, r from the origin, which was the centre of mass: what the vehicle is lifts, turns and is turned
 * with it.
 *
 *   m' = m + m_p,  I' = I + m_p (|r|^2 - r r^T) (its diagonal),
 *   F = -m_p (alpha x r + omega x (omega x r)),  M = -m_p r x (sum(T_i a_i) / m')
 *
 * Newton and Euler about a point that is not the centre of mass (Greenwood 2003, Advanced Dynamics, 3.2). The moment is
 * that of the weight and of the vehicle's acceleration by its thrust; other forces are of second order in it. */
#include "effect.h"

enum { MASS, X_M, Y_M, Z_M };

static void adjust(sample_t *s, const vd *p) {
  const vd *r = p + X_M;
  vd square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
  s->mass += p[MASS];
  for (int k = 0; k < 3; k++) s->inertia[k] += p[MASS] * (square - r[k] * r[k]);
}

static void cross(const vd a[3], const vd b[3], vd out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)x, (void)dx;
  const vd *r = p + X_M;
  vd turning[3], inward[3], speeding[3], thrust[3], moment[3];
  cross(s->omega, r, turning);
  cross(s->omega, turning, inward);
  cross(s->omega_dot, r, speeding);
  thrust_vector(s, thrust);
  cross(r, thrust, moment);
  for (int k = 0; k < 3; k++) {
    add->force[k] -= p[MASS] * (speeding[k] + inward[k]);
    add->moment[k] -= p[MASS] / s->mass * moment[k];
  }
}

EFFECT(payload) = {
    .name = "payload",
    .title = "a mass fixed to the body",
    .equation = "m' = m + m_p, M = -m_p/m' r x sum(T_i a_i), I' = I + m_p (|r|^2 - r r^T)",
    .latex = "m' = m + m_p, \\quad M = -\\frac{m_p}{m'}\\, r \\times \\sum T_i\\, a_i, \\quad I' = I + m_p\\, "
             "(|r|^2 - r\\, r^T)",
    .reference = "Greenwood 2003",
    .channels = "force_x force_y force_z moment_x moment_y moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 4,
    .invariants = GES_INVARIANT_FREE_AIR,
    .parameters =
        {
         {.name = "mass_kg", .unit = "kg", .role = GES_AMPLITUDE, .value = 0.1, .neutral = 0, .low = 0, .high = 20,
          .doc = "mass of the payload"},
         {.name = "x_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "its place, forward", .fitted = 1, .reach = 0.5, .reach_over = "hull"},
         {.name = "y_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "its place, to the left", .fitted = 1, .reach = 0.5, .reach_over = "hull"},
         {.name = "z_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "its place, up"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "attitude voltage_or_rotor_speed",
    .search =
        {
         {.amplitudes = "mass_kg", .rule = "on_body", .axis = "x_m y_m"},
        },
    .adjust = adjust,
    .wrench = wrench,
};
