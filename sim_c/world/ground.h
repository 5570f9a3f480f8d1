/* Height, gradient and Laplacian of the ground under every lane: see terrain.h for the formulas. */
#ifndef GES_GROUND_H
#define GES_GROUND_H

#include "terrain.h"

static inline void load_feature(ground_lanes_t *g, int side, int i, const terrain_t *t, double index) {
  static const feature_t flat = {0.0, 1.0, 0.0, 1.0, 0.0, 0.0};
  int inside = index >= 0.0 && index < (double)t->n_features;
  const feature_t *f = inside ? &t->features[(int)index] : &flat;
  const double value[6] = {f->xc, f->inverse_lx, f->yc, f->inverse_ly, f->a0, f->a1};
  for (int k = 0; k < 6; k++) set_rotors(&g->feature[side][k], i, value[k]);
}

static inline void load_lane(ground_lanes_t *g, int i, double left) {
  const terrain_t *t = g->terrain[i];
  load_feature(g, 0, i, t, left);
  load_feature(g, 1, i, t, left + 1.0);
  set_lane(&g->left, i, left);
  set_rotors(&g->edge, i, (left + 1.0) * t->slot);
}

/* Make the features within half a slot of x available to every lane. */
static inline void ground_move(ground_lanes_t *g, vd x) {
  if (g->kind != 1) return;
  vd left = nearest(x * g->inverse_slot) - 1.0;
  if (!any(NE(left, g->left))) return;
  for (int i = 0; i < GES_W; i++)
    if (lane(left, i) != lane(g->left, i)) load_lane(g, i, lane(left, i));
}

static inline void ground_make(ground_lanes_t *g, const terrain_t *const *terrain) {
  memset(g, 0, sizeof *g);
  g->kind = terrain[0]->kind;
  for (int i = 0; i < GES_W; i++) {
    const terrain_t *t = g->terrain[i] = terrain[i];
    set_rotors(&g->z, i, t->z);
    set_lane(&g->slot, i, t->slot);
    set_lane(&g->inverse_slot, i, t->slot > 0.0 ? 1.0 / t->slot : 0.0);
    set_rotors(&g->roughness, i, t->roughness);
    for (int k = 0; k < GES_WAVES; k++)
      for (int j = 0; j < 3; j++) set_rotors(&g->wave[k][j], i, t->wave[k][j]);
    if (g->kind == 1) load_lane(g, i, 0.0);
  }
  for (int k = 0; k < GES_WAVES; k++)
    g->wave[k][3] = (g->wave[k][0] * g->wave[k][0] + g->wave[k][1] * g->wave[k][1]) * g->roughness;
}

/* B(s) = max(1 - s^2, 0)^3 with its first two derivatives. */
INNER void bump(vr s, vr *b, vr *b1, vr *b2) {
  vr m = wide_max(1.0 - s * s, (vr){0});
  vr m2 = m * m;
  *b = m2 * m;
  *b1 = -6.0 * s * m2;
  *b2 = 24.0 * (s * s) * m - 6.0 * m2;
}

INNER void add_feature(const vr f[6], vr x, vr y, ground_wide_t *out) {
  vr s = (x - f[0]) * f[1], t = (y - f[2]) * f[3];
  vr b, b1, b2, q, q1, q2;
  bump(s, &b, &b1, &b2);
  bump(t, &q, &q1, &q2);
  vr a = f[4] + f[5] * s;
  vr p1 = f[5] * b + a * b1, p2 = 2.0 * f[5] * b1 + a * b2, p = a * b;
  out->height += p * q;
  out->gx += p1 * q * f[1];
  out->gy += p * q1 * f[3];
  out->laplacian += p2 * q * (f[1] * f[1]) + p * q2 * (f[3] * f[3]);
}

INNER void add_wave(const vr w[4], vr amplitude, vr x, vr y, ground_wide_t *out) {
  vr u = x * w[0] + y * w[1] + w[2];
  vr t = u - wide_nearest(u), t2 = t * t;
  vr slope = amplitude * (7.0 + t2 * (-120.0 + 240.0 * t2));
  out->height += amplitude * (t * (7.0 + t2 * (-40.0 + 48.0 * t2)));
  out->gx += w[0] * slope;
  out->gy += w[1] * slope;
  out->laplacian += w[3] * (t * (-240.0 + 960.0 * t2));
}

INNER void add_procedural(const ground_lanes_t *g, vr x, vr y, ground_wide_t *out) {
  vrl right = WIDE_GE(x, g->edge);
  vr f[6];
  for (int k = 0; k < 6; k++) f[k] = wide_sel(right, g->feature[1][k], g->feature[0][k]);
  add_feature(f, x, y, out);
  for (int k = 0; k < GES_WAVES; k++) add_wave(g->wave[k], g->roughness, x, y, out);
}

static inline double bounded(double x, double high) { return !(x > 0.0) ? 0.0 : x > high ? high : x; }

/* Bilinear height map; the gradient is that of the cell, the Laplacian 0. Needs nx, ny >= 2. */
static inline void add_grid_point(const ges_grid *m, int i, vr x, vr y, ground_wide_t *out) {
  double fx = bounded((x[i] - m->x0_m) / m->dx_m, (double)(m->nx - 1));
  double fy = bounded((y[i] - m->y0_m) / m->dy_m, (double)(m->ny - 1));
  int ix = (int)fx < m->nx - 1 ? (int)fx : m->nx - 2, iy = (int)fy < m->ny - 1 ? (int)fy : m->ny - 2;
  const double *z = m->z_m + (int64_t)iy * m->nx + ix;
  double u = fx - ix, v = fy - iy;
  double south = z[0] + u * (z[1] - z[0]), north = z[m->nx] + u * (z[m->nx + 1] - z[m->nx]);
  double west = z[0] + v * (z[m->nx] - z[0]), east = z[1] + v * (z[m->nx + 1] - z[1]);
  out->height[i] += south + v * (north - south);
  out->gx[i] = (east - west) / m->dx_m;
  out->gy[i] = (north - south) / m->dy_m;
}

/* Apart from the rest: what writes single lanes has to be in memory. */
static __attribute__((noinline)) void grid_at(const ground_lanes_t *g, vr x, vr y, ground_wide_t *out) {
  *out = (ground_wide_t){.height = g->z};
  for (int i = 0; i < GES_WIDE; i++) add_grid_point(g->terrain[i / GES_ABREAST]->grid, i, x, y, out);
}

/* Ground at the points (x, y), both within half a slot of the last ground_move(). */
INNER ground_wide_t ground_under(const ground_lanes_t *g, vr x, vr y) {
  ground_wide_t out = {.height = g->z}, grid;
  if (g->kind == 1) add_procedural(g, x, y, &out);
  if (g->kind != 2) return out;
  grid_at(g, x, y, &grid);
  return grid;
}

INNER ground_t ground_at(const ground_lanes_t *g, vd x, vd y) {
  ground_wide_t out = ground_under(g, all_rotors(x), all_rotors(y));
  return (ground_t){rotor(out.height, 0), rotor(out.gx, 0), rotor(out.gy, 0), rotor(out.laplacian, 0)};
}

/* Into the arrays of a sample, from rotor i on. */
INNER void put_grounds(grounds_t *to, int i, const ground_wide_t *g) {
  put_rotors(to->height + i, g->height);
  put_rotors(to->gx + i, g->gx);
  put_rotors(to->gy + i, g->gy);
  put_rotors(to->laplacian + i, g->laplacian);
}

#endif
