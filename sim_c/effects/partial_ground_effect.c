/* Over edges and steps a rotor gains by the part of its disc over the high ground: the gain is averaged over eight
 * points on a circle of radius k R under the hub instead of taken at its centre. He & Leang 2020 (disc overlap). */
#include "effect.h"

#include "../world/ground.h"

enum { POINTS = 8 };

/* One coordinate of the hubs from rotor i on. */
static vr hubs(const sample_t *s, int axis, int i) {
  vr hub = all_rotors(s->hub[i][axis]);
  for (int j = 1; j < GES_ABREAST; j++) set_rotor(&hub, j, s->hub[i + j][axis]);
  return hub;
}

/* Thrust gains with every hub's ground taken k radii away in the direction (cx, cy) of the world. */
static void shifted_gain(const sample_t *s, vd k, double cx, double cy, vd thrust_gain[GES_ROTORS]) {
  sample_t moved = *s;
  for (int i = 0; i < ROTORS_OF(s); i += GES_ABREAST) {
    vr hub[3] = {hubs(s, 0, i), hubs(s, 1, i), hubs(s, 2, i)}, reach = k * rotors_from(s->radius + i);
    vr x = s->p[0] + (s->r[0] * hub[0] + s->r[1] * hub[1] + s->r[2] * hub[2]);
    vr y = s->p[1] + (s->r[3] * hub[0] + s->r[4] * hub[1] + s->r[5] * hub[2]);
    ground_wide_t under = ground_under(s->map, x + cx * reach, y + cy * reach);
    put_grounds(&moved.under, i, &under);
    put_rotors(moved.height + i, rotors_from(s->height + i) + rotors_from(s->under.height + i) - under.height);
  }
  s->thrust_gain_at(&moved, s->thrust_gain_p, thrust_gain);
}

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  static const double circle[POINTS][2] = {{1, 0}, {0.7071067811865476, 0.7071067811865476}, {0, 1},
      {-0.7071067811865476, 0.7071067811865476}, {-1, 0}, {-0.7071067811865476, -0.7071067811865476}, {0, -1},
      {0.7071067811865476, -0.7071067811865476}};
  (void)x, (void)dx;
  if (!s->thrust_gain_at) return;
  for (int m = 0; m < POINTS; m++) {
    vd thrust_gain[GES_ROTORS];
    shifted_gain(s, p[0], circle[m][0], circle[m][1], thrust_gain);
    for (int i = 0; i < ROTORS_OF(s); i++)
      add->thrust[i] += s->thrust[i] * ((thrust_gain[i] - s->thrust_gain[i]) * (1.0 / POINTS));
  }
}

EFFECT(partial_ground_effect) = {
    .name = "partial_ground_effect",
    .title = "ground effect averaged over the rotor disc at edges",
    .equation = "f_i - 1 averaged over a circle of radius k R",
    .latex = "f_i - 1 \\text{ averaged over a circle of radius } k R",
    .reference = "He & Leang 2020",
    .modifies = "ground_effect",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 1,
    .invariants = GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "k", .unit = "1", .role = GES_AMPLITUDE, .value = 0.7, .neutral = 0, .low = 0, .high = 2,
          .doc = "radius of the circle over the rotor radius"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height",
    .search =
        {
         {.amplitudes = "k", .rule = "levels", .levels = LEVELS(0.4, 0.7, 1, 1.5)},
        },
    .ground = ground,
};
