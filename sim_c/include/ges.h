/* GES simulator: public interface.
 *
 * Conventions. World ENU, z up. Body FLU: x forward, y left, z along thrust. Quaternions are Hamilton, body to
 * world, scalar first. SI units and radians; a name that crosses this border carries its unit. Rotor spin is +1 for
 * counter-clockwise seen from above, -1 for clockwise; the reaction torque on the body has the opposite sign.
 *
 * Every number of a flight is one entry of a flat table of named doubles (sim/params.def); every recorded quantity
 * one entry of a table of columns (sim/columns.def); every physical effect one descriptor (effects/). All three can
 * be listed through this interface, so that no caller keeps a copy.
 *
 * Functions that can fail return 0 or a negative number and write one sentence into `error`.
 */
#ifndef GES_H
#define GES_H

#include <stdint.h>

#define GES_ABI 2
#define GES_ROTORS 4
#define GES_MAX_EFFECTS 40       /* effects switched on in one flight */
#define GES_MAX_PARAMETERS 12    /* parameters of one effect */
#define GES_MAX_STATES 8         /* extra states of one effect */
#define GES_REFERENCE_COLUMNS 14 /* p_ref[3] v_ref[3] a_ref[3] yaw_ref, excitation: angular acc. [3], vertical acc. */
#define GES_REPLAY_COLUMNS 12    /* drive[4] q[4] battery_V omega[3] */

typedef struct {
  const char *name, *unit, *doc;
  double value, low, high; /* default and bounds, both allowed */
} ges_parameter;

typedef struct {
  const char *name, *unit, *doc;
} ges_column;

typedef struct {
  const char *name, *unit, *doc;
  double value;     /* a typical size, used when an effect is switched on by name alone */
  double neutral;   /* the effect vanishes here (NaN: this parameter alone cannot switch it off) */
  double low, high; /* fit bounds, both allowed */
} ges_effect_parameter;

enum { GES_WRENCH = 0, GES_ACTUATOR = 1, GES_SENSOR = 2, GES_WIND = 3, GES_PARAMETER = 4 };

/* Laws an effect promises; the contract tests hold it to them. */
enum {
  GES_LAW_MIRROR = 1,     /* reflecting the vehicle left-right reflects the wrench */
  GES_LAW_DISSIPATES = 2, /* never feeds energy into the motion relative to the air */
  GES_LAW_NO_WORK = 4,    /* its power is zero */
  GES_LAW_FADES = 8,      /* vanishes far from the ground */
  GES_LAW_FREE_AIR = 16   /* does not depend on the ground */
};

typedef struct {
  const char *name, *title, *equation, *reference;
  const char *modifies; /* name of the effect without which this one is nothing, or NULL */
  const char *channels; /* space-separated: force_x ... moment_z drive range gyro acc attitude */
  int kind, n_parameters, n_states;
  unsigned laws;
  const ges_effect_parameter *parameters;
} ges_effect_info;

/* A height map, row-major z[iy * nx + ix] over uniform x and y (m); outside it the edge value holds. */
typedef struct {
  int nx, ny;
  double x0_m, y0_m, dx_m, dy_m;
  const double *z_m;
} ges_grid;

/* Effects switched on, in any order. */
typedef struct {
  int n;
  int id[GES_MAX_EFFECTS];
  double value[GES_MAX_EFFECTS][GES_MAX_PARAMETERS];
} ges_effects;

typedef struct {
  const double *parameters; /* one value per entry of the parameter table */
  ges_effects effects;
  const ges_grid *grid;     /* needed by terrain_kind 2 */
  const double *inputs;     /* n_inputs rows of reference or replay columns, or NULL */
  int n_inputs;
  double *out;              /* n_rows x n_columns, row-major; rows after a stop are NaN */
  int n_rows;
  int stopped_row;          /* out: -1, or the first row that holds no state */
  double stopped_t_s;       /* out: when a state stopped being finite */
  const char *stopped_field;/* out: which one, or NULL */
} ges_flight;

#ifdef __cplusplus
extern "C" {
#endif

int ges_abi(void);
int ges_parameters(const ges_parameter **table);
int ges_columns(const ges_column **table);
int ges_replay_columns(const ges_column **inputs, int *n_inputs, const ges_column **outputs, int *n_outputs);
int ges_effect_count(void);
int ges_effect(int id, ges_effect_info *info);

/* Fly n flights; columns selects what is recorded; lanes is 0 (choose), 1, 2, 4 or 8. Results do not depend on it. */
int ges_fly(ges_flight *flights, int n, const int *columns, int n_columns, int lanes, char *error, int error_size);

/* Rows a flight records. */
int ges_rows(const double *parameters);

/* The model's forces, drive and readings along n recorded samples under each of n_sets sets of effects:
 * in[i_column * n + i], out[(i_set * n_columns + i_column) * n + i].
 * Effects without states take lanes of samples; with states lanes of sets, through the samples in order. */
int ges_replay(const double *parameters, const ges_effects *sets, int n_sets, const ges_grid *grid, const double *in,
               int64_t n, double *out, int lanes, char *error, int error_size);

/* Height (m), slope components, and Laplacian (1/m) of the ground of a flight at n points. */
int ges_terrain(const double *parameters, const ges_grid *grid, const double *x_m, const double *y_m, int64_t n,
                double *height_m, double *slope_x, double *slope_y, double *curvature_1_m, char *error,
                int error_size);

/* The exported network on 13 features: what the firmware computes. */
int ges_network(const float *features, float *factor);

#ifdef __cplusplus
}
#endif

#endif
