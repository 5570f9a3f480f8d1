/* Load on a thread: a pendulum below the body, and its weight.
 *
 * Load at horizontal position l (states l, dl/dt): l'' = (g/L)(p - l) - 2 z sqrt(g/L) (l' - v); force on the vehicle
 * -m_l (l'' , g) at the attachment point. Small swings; the load's vertical acceleration is left out.
 */
#include "effect.h"

static void begin(const sample_t *s, const vd *p, vd *x) {
  (void)p;
  for (int k = 0; k < 2; k++) {
    x[k] = s->p[k];
    x[2 + k] = s->v[k];
  }
}

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  vd rate2 = s->gravity / p[1], damping = 2.0 * p[2] * lane_sqrt(rate2), world[3];
  for (int k = 0; k < 2; k++) {
    vd pull = rate2 * (s->p[k] - x[k]) + damping * (s->v[k] - x[2 + k]);
    dx[k] = x[2 + k];
    dx[2 + k] = pull;
    world[k] = -p[0] * pull;
  }
  world[2] = -p[0] * s->gravity;
  vd body[3];
  for (int k = 0; k < 3; k++) body[k] = s->r[k] * world[0] + s->r[3 + k] * world[1] + s->r[6 + k] * world[2];
  for (int k = 0; k < 3; k++) add->force[k] += body[k];
  add->moment[0] += p[4] * body[2];
  add->moment[1] -= p[3] * body[2];
  add->moment[2] += p[3] * body[1] - p[4] * body[0];
}

EFFECT(slung_load) = {
    .name = "slung_load",
    .title = "load on a thread",
    .equation = "l'' = (g/L)(p - l) - 2 z sqrt(g/L)(l' - v), F = -m_l (l'', g)",
    .reference = "pendulum dynamics",
    .channels = "force_x force_y force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 5,
    .n_states = 4,
    .laws = GES_LAW_FREE_AIR,
    .parameters = {{"mass_kg", "kg", "mass of the load", 0.1, 0, 0, 20},
                   {"length_m", "m", "length of the thread", 0.6, NAN, 0.05, 20},
                   {"damping", "1", "damping ratio of the swing", 0.02, NAN, 0, 1},
                   {"attach_x_m", "m", "attachment, forward", 0, NAN, -1, 1},
                   {"attach_y_m", "m", "attachment, left", 0, NAN, -1, 1}},
    .begin = begin,
    .wrench = wrench,
};
