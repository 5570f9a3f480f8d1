/* GES simulator: public interface.
 *
 * Conventions. World ENU, z up. Body FLU: x forward, y left, z along thrust. Quaternions are Hamilton, body to
 * world, scalar first. SI units and radians; a name that crosses this border carries its unit. Rotor spin is +1 for
 * counter-clockwise seen from above, -1 for clockwise; the reaction torque on the body has the opposite sign. A vehicle
 * has `rotors` rotors, the first of those in the tables.
 *
 * Every number of a flight is one entry of a flat table of named doubles (sim/params.def); every recorded quantity
 * one entry of a table of columns (sim/columns.def); every physical effect one descriptor (effects/); every mode of the
 * feedforward and every controller one row (firmware/modes.def, sim/controllers.def). All can be listed through this
 * interface, so that no caller keeps a copy.
 *
 * Functions that can fail return 0 or a negative number and write one sentence into `error`.
 */
#ifndef GES_H
#define GES_H

#include <stdint.h>

#define GES_ABI 12
#define GES_MAX_ROTORS 16
#define GES_MAX_EFFECTS 40       /* effects switched on in one flight */
#define GES_MAX_PARAMETERS 16    /* parameters of one effect */
#define GES_MAX_TERMS 24         /* terms of the laws of one flight */
#define GES_MAX_GROUPS 16        /* dimensionless groups that terms are made of */
#define GES_REFERENCE_COLUMNS 14 /* p_ref[3] v_ref[3] a_ref[3] yaw_ref, excitation: angular acc. [3], vertical acc. */
#define GES_REPLAY_COLUMNS 8     /* q[4] battery_V omega[3], behind a drive for every rotor */
/* A macro for every rotor there may be, numbered from 1. */
#define EACH_ROTOR(M) M(1) M(2) M(3) M(4) M(5) M(6) M(7) M(8) M(9) M(10) M(11) M(12) M(13) M(14) M(15) M(16)

typedef struct {
  const char *name, *unit, *doc;
  double value, low, high; /* default and bounds, both allowed */
} ges_parameter;

/* Of a rotor: its number from 1; GES_EACH_ROTOR: a "#" in the name stands for it, a column for every one; else 0. */
typedef struct {
  const char *name, *unit, *doc;
  int rotor;
} ges_column;

enum { GES_EACH_ROTOR = -1 };

/* A row of a table of choices: a feedforward mode, or a controller with the columns of its input table. */
typedef struct {
  const char *name, *doc;
  int input_columns; /* 0: reads no table of its own */
  int rotor_columns; /* 1: before these one for every rotor */
} ges_choice;

/* A height map, row-major z[iy * nx + ix] over uniform x and y (m); outside it the edge value holds. */
typedef struct {
  int nx, ny;
  double x0_m, y0_m, dx_m, dy_m;
  const double *z_m;
} ges_grid;

/* A dimensionless group, quantity over reference, both in `unit`, and what has to be recorded to know it. */
typedef struct {
  const char *quantity, *reference, *unit, *needs, *doc;
} ges_group;

enum { GES_SCALE_WEIGHT = 0, GES_SCALE_THRUST = 1 };

/* A term of a law, see effects/law.h: into channel (0 to 2 force, 3 to 5 moment, body frame), scale times the product
 * of g^power |g|^magnitude over the groups g. */
typedef struct {
  int channel, scale;
  int power[GES_MAX_GROUPS], magnitude[GES_MAX_GROUPS];
  double near_m[3]; /* x, y and width of the place about which it acts, see effects/law.h; a width of 0: everywhere */
} ges_term;

/* Effects switched on, in any order, and the terms of laws, each with its coefficient. */
typedef struct {
  int n;
  int id[GES_MAX_EFFECTS];
  double value[GES_MAX_EFFECTS][GES_MAX_PARAMETERS];
  int n_terms;
  ges_term term[GES_MAX_TERMS];
  double coefficient[GES_MAX_TERMS];
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
/* In the order of the tables; those of the rotors come last. */
int ges_replay_columns(const ges_column **inputs, int *n_inputs, const ges_column **outputs, int *n_outputs);
int ges_modes(const ges_choice **table);
int ges_controllers(const ges_choice **table);
/* Name of an effect, by its number from 0, or NULL; and its parameters: how many of the GES_MAX_PARAMETERS of a list. */
const char *ges_effect(int id);
int ges_effect_parameters(int id, ges_parameter *list);
/* The descriptors of all effects (effects/descriptor.h) in JSON, with NaN and Infinity: a list in the order of their numbers.
 * The text stays where it is. */
const char *ges_describe_effects(void);
int ges_groups(const ges_group **table);

/* Fly n flights; columns selects what is recorded; lanes is 0 (choose) or at most 1, 2, 4 or 8. Results do not
 * depend on it. */
int ges_fly(ges_flight *flights, int n, const int *columns, int n_columns, int lanes, char *error, int error_size);

/* Rows a flight records; none where a parameter is not allowed, which ges_fly says. */
int ges_rows(const double *parameters);

/* The model's forces, drive and readings along n recorded samples under each of n_sets sets of effects; columns selects
 * what is given: in[i_column * n + i], out[(i_set * n_columns + i_column) * n + i].
 * Effects without states take lanes of samples; with states lanes of sets, through the samples in order. */
int ges_replay(const double *parameters, const ges_effects *sets, int n_sets, const ges_grid *grid, const double *in,
               int64_t n, const int *columns, int n_columns, double *out, int lanes, char *error, int error_size);

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
