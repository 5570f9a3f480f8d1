/* Mixer: what each rotor gives for a collective thrust and three moments, by Gauss-Jordan elimination with partial pivoting.
 *
 * Four rotors: the inverse of their effects B. Others: the pseudo-inverse B^T (B B^T)^-1, the least thrusts that do it. */
#include "firmware.h"

static void swap_rows(float a[4][8], int i, int j) {
  for (int k = 0; k < 8; k++) {
    float kept = a[i][k];
    a[i][k] = a[j][k];
    a[j][k] = kept;
  }
}

static int pivot_row(float a[4][8], int column) {
  int best = column;
  for (int i = column + 1; i < 4; i++)
    if (a[i][column] * a[i][column] > a[best][column] * a[best][column]) best = i;
  return best;
}

static int eliminate(float a[4][8], int column) {
  swap_rows(a, column, pivot_row(a, column));
  float pivot = a[column][column];
  if (pivot * pivot < 1e-24f) return 0;
  for (int k = 0; k < 8; k++) a[column][k] /= pivot;
  for (int i = 0; i < 4; i++) {
    float factor = a[i][column];
    if (i == column) continue;
    for (int k = 0; k < 8; k++) a[i][k] -= factor * a[column][k];
  }
  return 1;
}

/* Invert the left half of `a` into its right half. */
static int invert(float a[4][8]) {
  for (int j = 0; j < 4; j++) a[j][4 + j] = 1.0f;
  for (int column = 0; column < 4; column++)
    if (!eliminate(a, column)) return 0;
  return 1;
}

/* Rows scaled to the size of the first, so that one threshold of pivots serves vehicles of every size. */
static void scale_rows(int rotors, const float effect[4][FIRMWARE_MAX_ROTORS], float scale[4]) {
  for (int k = 0; k < 4; k++) {
    scale[k] = 1e-12f;
    for (int i = 0; i < rotors; i++) scale[k] = effect[k][i] * effect[k][i] > scale[k] * scale[k] ? effect[k][i] : scale[k];
    if (scale[k] < 0.0f) scale[k] = -scale[k];
  }
}

int mixer_make(int rotors, float effect[4][FIRMWARE_MAX_ROTORS], float mixer[FIRMWARE_MAX_ROTORS][4]) {
  float a[4][8] = {{0}}, scale[4];
  if (rotors == 4) {
    for (int k = 0; k < 4; k++)
      for (int j = 0; j < 4; j++) a[k][j] = effect[k][j];
    if (!invert(a)) return 0;
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++) mixer[i][j] = a[i][4 + j];
    return 1;
  }
  scale_rows(rotors, effect, scale);
  for (int k = 0; k < 4; k++)
    for (int j = 0; j < 4; j++)
      for (int i = 0; i < rotors; i++) a[k][j] += effect[k][i] / scale[k] * (effect[j][i] / scale[j]);
  if (!invert(a)) return 0;
  for (int i = 0; i < rotors; i++)
    for (int j = 0; j < 4; j++) {
      mixer[i][j] = 0.0f;
      for (int k = 0; k < 4; k++) mixer[i][j] += effect[k][i] / scale[k] * a[k][4 + j] / scale[j];
    }
  return 1;
}
