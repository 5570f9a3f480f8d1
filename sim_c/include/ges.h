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

#define GES_ABI 9
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

/* What a parameter is to a fit: a coefficient that scales the effect, a shape that is searched or fitted, or a number
 * that whoever switches the effect on has to know. */
enum { GES_AMPLITUDE = 1, GES_SHAPE = 2, GES_SWITCH = 3 };

/* Trims of a vehicle, fitted to flights that are known to be good. */
enum { GES_TRIM_THRUST = 1, GES_TRIM_ROTOR = 2, GES_TRIM_LEVER = 3, GES_TRIM_YAW = 4 };

typedef struct {
  const char *name;
  double value;
} ges_setting;

/* Of a drive's delay the doubt takes in how long commands are held, of its lag what a command does between two rows of
 * the log; of both what a motor's second pole looks like. */
enum { GES_TIMING_DELAY = 1, GES_TIMING_LAG = 2 };

/* How far a parameter may be off without any finding: a trim, a sensor, a drive that no vehicle file states. */
typedef struct {
  const char *shows_in; /* channels, or blocks of them, of which one has to be there; "any"; NULL: never off */
  double step;          /* from neutral, at which it is linearised */
  double sd, flight_sd; /* usual doubt, and how much flights of one vehicle differ */
  double mean;
  int per_arm;          /* step and doubts are in arm lengths */
  int reciprocal;       /* acts as 1/(1 + x): linear up to where the doubt ends */
  int timing;           /* what the recording adds to the doubt, see below */
  int with_voltage;     /* free where every flight logged the battery's voltage */
  double unlogged_voltage_sd; /* from flight to flight, where neither that nor rotor speeds were logged */
} ges_doubt;

typedef struct {
  const char *name, *unit, *doc;
  int role;
  double value;     /* a typical size, used when an effect is switched on by name alone */
  double neutral;   /* the effect vanishes here, or is what a vehicle has that does not state it (NaN: neither) */
  double low, high; /* both allowed */
  double fit_low, fit_high; /* narrower bounds of a fit; both 0: low and high */
  double plausible;         /* amplitude: sd that is plausible by itself; 0: by what it makes of the flights' forces */
  double usual, usual_sd;   /* shape: where it usually is; sd 0: nothing is usual */
  double usual_share;       /* amplitude: of the weight, at 1 m/s; where another effect needs this one to act through */
  int fitted;               /* shape that flights may move */
  int whole;                /* axis of a vector that is fitted whole */
  int rotor;                /* the rotor that it belongs to, from 1, or 0 */
  int trim;
  const char *corrects;     /* numbers of the vehicle file that it corrects, or NULL */
  ges_setting acts_above;   /* shape that does something where this parameter is above this value alone */
  double reach;             /* shape that is a place or a length: share of `reach_over` that a fit may move it at once */
  const char *reach_over;   /* "radius", or a parameter */
  ges_doubt doubt;
} ges_effect_parameter;

#define GES_MAX_LEVELS 40
#define GES_MAX_SEARCHES 6
#define LEVELS(...) .levels = {__VA_ARGS__}, .n_levels = (int)(sizeof((double[]){__VA_ARGS__}) / sizeof(double))

/* Variants of an effect that a search tries: amplitudes that are fitted together, over levels of an axis. */
typedef struct {
  const char *amplitudes; /* space-separated; "*" for the number of every rotor */
  const char *rule;       /* how variants are laid out (ges.diagnose.library.grids); NULL: one for each level of the axis */
  ges_setting fixed[4];
  const char *axis;       /* parameters that vary, space-separated, or NULL */
  const char *across;     /* one more, over the doubt that the vehicle file has of it, or NULL */
  double levels[GES_MAX_LEVELS];
  int n_levels;
  int modified;           /* with each effect that modifies this one, at its `carried` levels */
} ges_search;

enum { GES_WRENCH = 0, GES_ACTUATOR = 1, GES_SENSOR = 2, GES_WIND = 3, GES_PARAMETER = 4 };

/* What stays true of an effect whatever the state; the contract tests hold it to that. */
enum {
  GES_INVARIANT_MIRROR = 1,     /* reflecting the vehicle left-right reflects the wrench */
  GES_INVARIANT_DISSIPATES = 2, /* never feeds energy into the motion relative to the air */
  GES_INVARIANT_NO_WORK = 4,    /* its power is zero */
  GES_INVARIANT_FADES = 8,      /* vanishes far from the ground */
  GES_INVARIANT_FREE_AIR = 16   /* does not depend on the ground */
};

/* What a finding is about: physics that a simulator lacks, a number that it has wrong, or a sensor. */
enum { GES_PHYSICS = 1, GES_DECLARED = 2, GES_FAULT = 3 };

/* How the controller's feedback shows in what an effect makes of a flight; an effect that states none does not load.
 * Dynamic: it follows the changes of rotor speeds, with which the controller answers disturbances. Thrust gain: it
 * multiplies thrust. Rotor: it takes from one rotor. Load: it hangs below. Height: the height that it is held against
 * is a reading. */
enum {
  GES_FEEDBACK_NONE = 1,
  GES_FEEDBACK_DYNAMIC = 2,
  GES_FEEDBACK_THRUST_GAIN = 3,
  GES_FEEDBACK_ROTOR = 4,
  GES_FEEDBACK_LOAD = 5,
  GES_FEEDBACK_HEIGHT = 6
};

enum {
  GES_OWN_LEVER = 1,         /* its moments have a coefficient of their own: their lever is not known */
  GES_LEVER_OF_CARRIER = 2,  /* it is that coefficient, of the effect that it modifies */
  GES_CLIPS = 4,             /* a share of its step says nothing of it */
  GES_UNLIKE_FORM_ERROR = 8, /* does not look like what the form of a larger effect is wrong by */
  GES_RANDOM = 16,           /* another one in every flight: a vehicle file does not know which */
  GES_READS_VOLTAGE = 32,
  GES_MANY = 64              /* a vehicle that has one may have more of it */
};

typedef struct {
  const char *name, *title, *equation, *reference;
  const char *modifies; /* name of the effect without which this one is nothing, or NULL */
  const char *channels; /* space-separated: force_x ... moment_z drive range gyro acc attitude */
  int kind, n_parameters, n_states;
  unsigned invariants;
  const ges_effect_parameter *parameters;
  int about, feedback;
  unsigned hints;
  double rarity;              /* how often it is met, over others; 0: as often */
  const char *needs;          /* what has to be recorded, space-separated (ges.diagnose.library.requirements), or NULL */
  const char *through;        /* effects of which one has to be on for this one to act, or NULL */
  const char *family;         /* effects of one family act in one place, or NULL */
  const char *usual_beside;   /* what is there as a rule, and looks like this one, or NULL */
  const char *error_of;       /* the larger effect whose form may be wrong by what looks like this one, or NULL */
  const char *settled;        /* why it enters no search, or NULL */
  const double *carried;      /* levels at which it is tried together with what it modifies */
  int n_carried, n_searches;
  const ges_search *searches; /* none: all amplitudes together */
} ges_effect_info;

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
int ges_effect_count(void);
int ges_effect(int id, ges_effect_info *info);
int ges_groups(const ges_group **table);

/* Fly n flights; columns selects what is recorded; lanes is 0 (choose) or at most 1, 2, 4 or 8. Results do not
 * depend on it. */
int ges_fly(ges_flight *flights, int n, const int *columns, int n_columns, int lanes, char *error, int error_size);

/* Rows a flight records; none where a parameter is not allowed, which ges_fly says. */
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
