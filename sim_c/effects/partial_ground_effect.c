/* Over edges and steps a rotor gains by the part of its disc over the high ground: the gain is averaged over eight
 * points on a circle of radius k R under the hub instead of taken at its centre. He & Leang 2020 (disc overlap). */
#include "effect.h"

#include "../world/ground.h"

enum { POINTS = 8 };

/* Thrust gains with every hub's ground taken k radii away in the direction (cx, cy) of the world. */
static void shifted_gain(const sample_t *s, vd k, double cx, double cy, vd thrust_gain[GES_ROTORS]) {
  sample_t moved = *s;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd reach = k * s->radius[i];
    vd x = s->p[0] + (s->r[0] * s->hub[i][0] + s->r[1] * s->hub[i][1] + s->r[2] * s->hub[i][2]);
    vd y = s->p[1] + (s->r[3] * s->hub[i][0] + s->r[4] * s->hub[i][1] + s->r[5] * s->hub[i][2]);
    moved.under[i] = ground_at(s->map, x + cx * reach, y + cy * reach);
    moved.height[i] = s->height[i] + s->under[i].height - moved.under[i].height;
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
