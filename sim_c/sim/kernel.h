/* The compiled step for one number of rotors and one lane width; batch.c chooses among them. */
#ifndef GES_KERNEL_H
#define GES_KERNEL_H

#include "../include/ges.h"

/* What the flights of one group share; the rest may differ from lane to lane. */
typedef struct {
  int rotors;
  int allocation; /* of the firmware */
  int n_steps, control_every, telemetry_every, record_every;
  int integrator, control, attitude_imposed;
  int references; /* whether there is an input table, and it holds references */
  int n_effects, effect[GES_MAX_EFFECTS]; /* in the order of effects.def */
  int n_terms;
  ges_term term[GES_MAX_TERMS];
} plan_t;

enum {
#define X(name, run, impose, speeds_imposed, input_columns, rotor_columns, doc) CONTROL_##name,
#include "controllers.def"
#undef X
  N_CONTROLLERS
};

typedef struct {
  int lanes;
  /* Fly `n` <= lanes flights that share a plan. terrain[i] belongs to flights[i]. Returns 0 on a bad rotor layout. */
  int (*fly)(const plan_t *plan, ges_flight *const *flights, const void *const *terrain, int n, const int *columns,
             int n_columns);
  /* A replay of `n_sets` <= lanes sets that share a plan, of one where it has no states; out[i] belongs to sets[i]. */
  void (*replay)(const double *parameters, const plan_t *plan, const ges_effects *const *sets, double *const *out, int n_sets,
                 const void *terrain, const double *in, int64_t n, const int *columns, int n_columns);
} kernel_t;

/* X(number of rotors) of every unit; that of GES_MAX_ROTORS serves every vehicle. */
#define EACH_UNIT(X) X(4) X(6) X(8) X(16)
#define X(rotors) extern const kernel_t kernel_r##rotors##_w1, kernel_r##rotors##_w2, kernel_r##rotors##_w4, kernel_r##rotors##_w8;
EACH_UNIT(X)
#undef X

#endif
