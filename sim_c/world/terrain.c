/* Layout of the ground: see terrain.h. Scalar, once a flight. */
#define GES_W 1
#include "terrain.h"

#include <stdlib.h>

#include "../core/random.h"
#include "../sim/parameters.h"

static double uniform(uint32_t *state) { return (double)xorshift32(state) * (1.0 / 4294967296.0); }
static double between(uint32_t *state, double low, double high) { return low + (high - low) * uniform(state); }

static feature_t draw_feature(uint32_t *state, const double *p, double slot, int i) {
  const double undulation = 4.201355091181271; /* 7^3.5 / 216: (s B(s)) peaks at s^2 = 1/7 */
  double lx = slot * between(state, 0.25, 0.49);
  double xc = slot * ((double)i + 0.5) + (0.499 * slot - lx) * between(state, -1.0, 1.0);
  double ly = 0.5 * between(state, p[P_terrain_width_min_m], p[P_terrain_width_max_m]);
  double yc = ly * between(state, -0.3, 0.3);
  double amplitude = between(state, p[P_terrain_amplitude_min_m], p[P_terrain_amplitude_max_m]);
  uint32_t shape = xorshift32(state) % 4u;
  double a0 = shape == 0 ? amplitude : shape == 1 ? -amplitude : 0.0;
  double a1 = shape < 2 ? 0.0 : (shape == 2 ? amplitude : -amplitude) * undulation;
  return (feature_t){xc, 1.0 / lx, yc, 1.0 / ly, a0, a1};
}

static void draw_waves(uint32_t *state, terrain_t *t, double wavelength) {
  static const double direction[GES_WAVES][2] = {{1.0, 0.0}, {0.0, 1.0}};
  for (int k = 0; k < GES_WAVES; k++) {
    double cycles = between(state, 0.8, 1.25) / wavelength;
    double mix = between(state, -0.5, 0.5);
    t->wave[k][0] = cycles * (direction[k][0] - mix * direction[k][1]);
    t->wave[k][1] = cycles * (direction[k][1] + mix * direction[k][0]);
    t->wave[k][2] = uniform(state);
  }
}

static int draw_procedural(terrain_t *t, const double *p) {
  double seed = p[P_terrain_seed] < 0.0 ? p[P_seed] : p[P_terrain_seed];
  uint64_t mixed = (uint64_t)seed;
  uint32_t state = (uint32_t)splitmix64(&mixed) | 1u; /* xorshift32 must not start at 0 */
  uint32_t low = (uint32_t)p[P_terrain_features_min], high = (uint32_t)p[P_terrain_features_max];
  t->n_features = (int)(low + xorshift32(&state) % (high - low + 1u));
  t->slot = p[P_terrain_length_m] / (double)t->n_features;
  t->features = malloc((size_t)t->n_features * sizeof *t->features);
  if (!t->features) return 0;
  draw_waves(&state, t, p[P_terrain_roughness_length_m]);
  t->roughness = p[P_terrain_roughness_m] * (1.0 / 2.344); /* two waves of peak 1.172 */
  for (int i = 0; i < t->n_features; i++) t->features[i] = draw_feature(&state, p, t->slot, i);
  return 1;
}

int terrain_make(terrain_t *t, const double *parameters, const ges_grid *grid) {
  memset(t, 0, sizeof *t);
  t->kind = (int)parameters[P_terrain_kind];
  t->z = parameters[P_terrain_z_m];
  t->grid = grid;
  return t->kind == 1 ? draw_procedural(t, parameters) : 1;
}

void terrain_free(terrain_t *t) {
  free(t->features);
  t->features = 0;
}
