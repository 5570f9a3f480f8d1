/* Ground: flat, procedural from a seed, or a height map.
 *
 * Procedural: the track x in [0, length] is cut into n equal slots, n drawn from [features_min, features_max]; each
 * slot holds one feature that lies inside it, so features do not overlap along the track:
 *   h(x, y) = A (k0 + k1 s) B(s) B(t),  s = (x - xc)/lx,  t = (y - yc)/ly,  B(s) = (1 - s^2)^3 for |s| < 1 else 0,
 * a bump (k0 = 1), a dip (k0 = -1) or an undulation (k1 = +-7^3.5/216, peak 1). Fine roughness adds two crossing
 * plane waves of the periodic quintic w(t) = 7t - 40t^3 + 48t^5, t in [-1/2, 1/2], which is twice continuously differentiable.
 * Gradient and Laplacian are exact derivatives. The numpy port (src/ges/terrain.py) repeats every operation in the
 * same order: equal bit for bit.
 */
#ifndef GES_TERRAIN_H
#define GES_TERRAIN_H

#include "../core/lanes.h"
#include "../include/ges.h"

#define GES_WAVES 2

typedef struct {
  double xc, inverse_lx, yc, inverse_ly, a0, a1;
} feature_t;

typedef struct {
  int kind; /* 0 flat, 1 procedural, 2 grid */
  double z;
  int n_features;
  double slot;
  feature_t *features; /* n_features, owned */
  double wave[GES_WAVES][3]; /* cycles per metre along x and y, phase */
  double roughness;
  const ges_grid *grid;
} terrain_t;

/* Lay out the ground of one flight from its parameter table. Returns 0 when memory runs out. */
int terrain_make(terrain_t *terrain, const double *parameters, const ges_grid *grid);
void terrain_free(terrain_t *terrain);

typedef struct {
  vd height, gx, gy, laplacian;
} ground_t;

/* The same under rotors abreast. */
typedef struct {
  vr height, gx, gy, laplacian;
} ground_wide_t;

/* Below every rotor. */
typedef struct {
  vd height[GES_ROTORS], gx[GES_ROTORS], gy[GES_ROTORS], laplacian[GES_ROTORS];
} grounds_t;

/* Ground of every lane with the two features around a lane's vehicle at hand: valid for points within half a slot
 * of the place it was last moved to. Points of one lane share one terrain. */
typedef struct {
  const terrain_t *terrain[GES_W];
  int kind;
  vd slot, inverse_slot, left;
  vr z, edge, feature[2][6];
  vr wave[GES_WAVES][4], roughness; /* cycles per metre along x and y, phase, roughness times squared wave number */
} ground_lanes_t;

#endif
