/* Mixer: inverse of [1; y; -x; yaw] by Gauss-Jordan elimination with partial pivoting. */
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

int mixer_make(const float x[4], const float y[4], const float yaw[4], float mixer[4][4]) {
  float a[4][8] = {{0}};
  for (int j = 0; j < 4; j++) {
    a[0][j] = 1.0f;
    a[1][j] = y[j];
    a[2][j] = -x[j];
    a[3][j] = yaw[j];
    a[j][4 + j] = 1.0f;
  }
  for (int column = 0; column < 4; column++)
    if (!eliminate(a, column)) return 0;
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++) mixer[i][j] = a[i][4 + j];
  return 1;
}
