/* Feet on the ground: a spring and damper along the vertical and Coulomb friction under each rotor.
 *
 * N = k d - c v_z while the foot is a depth d > 0 in the ground (never pulling), friction mu N against the sliding
 * velocity. s->contact is 1 while a foot touches, so that contact is never taken for flight.
 */
#ifndef GES_CONTACT_H
#define GES_CONTACT_H

#include "model.h"

static inline void foot_velocity(const sample_t *s, const vd foot[3], vd v[3]) {
  vd turn[3] = {s->omega[1] * foot[2] - s->omega[2] * foot[1], s->omega[2] * foot[0] - s->omega[0] * foot[2],
                s->omega[0] * foot[1] - s->omega[1] * foot[0]};
  for (int k = 0; k < 3; k++) v[k] = s->v[k] + row_dot(s->r + 3 * k, turn);
}

static inline void press_foot(const vehicle_t *b, const sample_t *s, const vd foot[3], vd depth, vd force[3], vd moment[3]) {
  vd v[3], world[3], body[3];
  vl touching = GT(depth, all_lanes(0.0));
  foot_velocity(s, foot, v);
  vd normal = lane_max(b->gear_stiffness * depth - b->gear_damping * v[2], all_lanes(0.0));
  normal = sel(touching, normal, all_lanes(0.0));
  vd slide = b->gear_friction * normal / (lane_sqrt(v[0] * v[0] + v[1] * v[1]) + 0.01);
  world[0] = -slide * v[0];
  world[1] = -slide * v[1];
  world[2] = normal;
  for (int k = 0; k < 3; k++) body[k] = column_dot(s->r, k, world);
  for (int k = 0; k < 3; k++) force[k] += body[k];
  moment[0] += foot[1] * body[2] - foot[2] * body[1];
  moment[1] += foot[2] * body[0] - foot[0] * body[2];
  moment[2] += foot[0] * body[1] - foot[1] * body[0];
}

static inline void add_contact(const vehicle_t *b, sample_t *s, vd force[3], vd moment[3]) {
  vd depth[GES_ROTORS], deepest = all_lanes(-1.0);
  vd push[3], turn[3];
  for (int k = 0; k < 3; k++) push[k] = turn[k] = all_lanes(0.0);
  for (int i = 0; i < ROTORS_OF(s); i++) {
    depth[i] = (s->hub[i][2] + b->gear_height) * s->r[8] - s->height[i];
    deepest = lane_max(deepest, depth[i]);
  }
  s->contact = sel(GT(deepest, all_lanes(0.0)), all_lanes(1.0), all_lanes(0.0));
  if (any(GT(deepest, all_lanes(0.0))))
    for (int i = 0; i < ROTORS_OF(s); i++) {
      const vd foot[3] = {s->hub[i][0], s->hub[i][1], -b->gear_height};
      press_foot(b, s, foot, depth[i], push, turn);
    }
  for (int k = 0; k < 3; k++) {
    force[k] += push[k];
    moment[k] += turn[k];
  }
}

#endif
