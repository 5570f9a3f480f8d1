/* What an effect says of itself: to people, to the simulator, and to a search for it in recorded flights.
 *
 * A list has a line for every field, F(kind of value, name), and for every choice, C(constant, its name outside of C). The
 * structs are made of the lists, and so is the text that other languages read (sim/describe.c): nothing is named twice. What
 * a descriptor leaves out is 0 or NULL.
 */
#ifndef GES_DESCRIPTOR_H
#define GES_DESCRIPTOR_H

#include "../include/ges.h"

#define GES_MAX_LEVELS 40
#define GES_MAX_SEARCHES 6

/* ---- choices: one of several, 0 where none is made ------------------------------------------------------------- */

#define GES_KINDS(C)                                                                                                    \
  C(GES_WRENCH, "wrench") C(GES_ACTUATOR, "actuator") C(GES_SENSOR, "sensor") C(GES_WIND, "wind") C(GES_PARAMETER, "parameter")

/* What a finding is about: physics that a simulator lacks, a number that it has wrong, or a sensor. */
#define GES_ABOUTS(C) C(GES_PHYSICS, "physics") C(GES_NOMINAL, "parameter") C(GES_FAULT, "sensor")

/* How the controller's feedback shows in what an effect makes of a flight; docs/adding-an-effect.md helps to choose. */
#define GES_FEEDBACKS(C)                                                                                                \
  C(GES_FEEDBACK_NONE, "none")                                                                                          \
  C(GES_FEEDBACK_DYNAMIC, "dynamic")         /* it follows changes of rotor speed, which answer disturbances */         \
  C(GES_FEEDBACK_THRUST_GAIN, "thrust_gain") /* it multiplies thrust */                                                 \
  C(GES_FEEDBACK_ROTOR, "rotor")             /* it takes from one rotor */                                              \
  C(GES_FEEDBACK_LOAD, "load")               /* it hangs below */                                                       \
  C(GES_FEEDBACK_HEIGHT, "height")           /* the height that the controller holds is a reading */

/* What a parameter is to a fit: a coefficient that scales the effect, a shape that is searched or fitted, a number that
 * whoever switches the effect on has to know, or a shape that scales its moment alone. */
#define GES_ROLES(C) C(GES_AMPLITUDE, "amplitude") C(GES_SHAPE, "shape") C(GES_SWITCH, "switch") C(GES_LEVER, "lever")

/* Trims of a vehicle, fitted to flights that are known to be good. */
#define GES_TRIMS(C)                                                                                                    \
  C(GES_TRIM_THRUST, "thrust") C(GES_TRIM_ROTOR, "rotor") C(GES_TRIM_LEVER, "lever") C(GES_TRIM_YAW, "yaw")

/* What the recording adds to the uncertainty of a drive: of a delay how long commands are held, of a lag what a command does
 * between two rows of the log; of both what a motor's second pole looks like. */
#define GES_TIMINGS(C) C(GES_TIMING_DELAY, "delay") C(GES_TIMING_LAG, "lag")

/* ---- sets of choices, written with | ---------------------------------------------------------------------------- */

/* What stays true of an effect whatever the state; the contract tests hold it to that. */
#define GES_INVARIANTS(C)                                                                                               \
  C(GES_INVARIANT_MIRROR, "mirror")         /* reflecting the vehicle left-right reflects the wrench */                 \
  C(GES_INVARIANT_DISSIPATES, "dissipates") /* never feeds energy into the motion relative to the air */                \
  C(GES_INVARIANT_NO_WORK, "no_work")       /* its power is zero */                                                     \
  C(GES_INVARIANT_FADES, "fades")           /* vanishes far from the ground */                                          \
  C(GES_INVARIANT_FREE_AIR, "free_air")     /* does not depend on the ground */

#define GES_HINTS(C)                                                                                                    \
  C(GES_OWN_LEVER, "own_lever")                 /* its moments have a coefficient of their own: their lever is not known */ \
  C(GES_LEVER_OF_CARRIER, "lever_of_carrier")   /* it is that coefficient, of the effect that it modifies */            \
  C(GES_CLIPS, "clips")                         /* a share of its step says nothing of it */                            \
  C(GES_RANDOM, "random")                       /* another one in every flight: a vehicle file does not know which */   \
  C(GES_READS_VOLTAGE, "reads_voltage")                                                                                 \
  C(GES_MANY, "many")                           /* a vehicle that has one may have more of it */

#define GES_CHOICE(constant, name) constant,
#define GES_PLACE(constant, name) constant##_PLACE,
#define GES_BIT(constant, name) constant = 1 << constant##_PLACE,
enum { GES_NO_KIND, GES_KINDS(GES_CHOICE) };
enum { GES_NO_ABOUT, GES_ABOUTS(GES_CHOICE) };
enum { GES_NO_FEEDBACK, GES_FEEDBACKS(GES_CHOICE) };
enum { GES_NO_ROLE, GES_ROLES(GES_CHOICE) };
enum { GES_NO_TRIM, GES_TRIMS(GES_CHOICE) };
enum { GES_NO_TIMING, GES_TIMINGS(GES_CHOICE) };
enum { GES_INVARIANTS(GES_PLACE) };
enum { GES_INVARIANTS(GES_BIT) };
enum { GES_HINTS(GES_PLACE) };
enum { GES_HINTS(GES_BIT) };

/* ---- kinds of values -------------------------------------------------------------------------------------------- */

typedef const char *ges_text, *ges_words; /* words: several, with spaces between */
typedef double ges_number;
typedef int ges_whole, ges_flag, ges_kind, ges_about, ges_feedback, ges_role, ges_trim, ges_timing, ges_invariants, ges_hints;

/* A parameter and a value of it. */
typedef struct {
  const char *name;
  double value;
} ges_setting;
typedef ges_setting ges_settings[4];

typedef struct {
  double at[GES_MAX_LEVELS];
  int n;
} ges_levels;
#define LEVELS(...) {.at = {__VA_ARGS__}, .n = (int)(sizeof((double[]){__VA_ARGS__}) / sizeof(double))}

/* ---- fields ----------------------------------------------------------------------------------------------------- */

/* How far a parameter may be off without any finding: a trim, a sensor, a drive that no vehicle file states. */
#define GES_PRIOR(F)                                                                                                    \
  F(words, shows_in)    /* channels, or blocks of them, of which one has to be there; "any"; NULL: never off */         \
  F(number, step)       /* from neutral, at which it is linearised */                                                   \
  F(number, sd)         /* usual standard deviation */                                                                  \
  F(number, flight_sd)  /* how much flights of one vehicle differ */                                                    \
  F(number, mean)                                                                                                       \
  F(flag, per_arm)      /* step and sds are in arm lengths */                                                           \
  F(flag, reciprocal)   /* acts as 1/(1 + x): linear within the sds */                                                  \
  F(timing, timing)                                                                                                     \
  F(flag, with_voltage) /* free where every flight logged the battery's voltage */                                      \
  F(number, unlogged_voltage_sd) /* from flight to flight, where that was not logged, nor, but of a drive, rotor speeds */

#define GES_EFFECT_PARAMETER(F)                                                                                         \
  F(text, name) F(text, unit) F(text, doc)                                                                              \
  F(role, role)                                                                                                         \
  F(number, value)         /* a typical size, used when an effect is switched on by name alone */                       \
  F(number, neutral)       /* the effect vanishes here, or is what a vehicle has that does not state it (NaN: neither) */ \
  F(number, low) F(number, high) /* both allowed */                                                                     \
  F(number, fit_low) F(number, fit_high) /* narrower bounds of a fit; both 0: low and high */                           \
  F(number, plausible)     /* amplitude: sd that is plausible by itself; 0: by what it makes of the flights' forces */  \
  F(number, usual) F(number, usual_sd) /* shape: where it usually is; sd 0: nothing is usual */                         \
  F(number, usual_share)   /* amplitude: of the weight, at 1 m/s; where another effect needs this one to act through */ \
  F(flag, fitted)          /* shape that flights may move */                                                            \
  F(flag, whole)           /* axis of a vector that is fitted whole */                                                  \
  F(whole, rotor)          /* the rotor that it belongs to, from 1, or 0 */                                             \
  F(trim, trim)                                                                                                         \
  F(words, corrects)       /* numbers of the vehicle file that it corrects */                                           \
  F(setting, acts_above)   /* shape that does something where this parameter is above this value alone */               \
  F(number, reach)         /* shape that is a place or a length: share of `reach_over` that a fit may move it at once */ \
  F(text, reach_over)      /* "radius", "hull" that a place on the body never leaves, or a parameter */                   \
  F(prior, prior)

/* Variants of an effect that a search tries: amplitudes that are fitted together, over levels of an axis. */
#define GES_SEARCH(F)                                                                                                   \
  F(words, amplitudes)  /* "*" for the number of every rotor */                                                         \
  F(text, rule)         /* how variants are laid out (ges.diagnose.library.grids); NULL: one for each level of the axis */ \
  F(settings, fixed)                                                                                                    \
  F(words, axis)        /* parameters that vary */                                                                      \
  F(text, across)       /* one more, over the sd that the vehicle file has of it */                                     \
  F(levels, levels)     /* values of the axis */                                                                        \
  F(flag, modified)     /* with each effect that modifies this one, at its `carried` levels */

#define GES_EFFECT(F)                                                                                                   \
  F(text, name) F(text, title) F(text, equation)                                                                        \
  F(text, latex)        /* the equation, typeset on pages */                                                            \
  F(text, reference)                                                                                                    \
  F(text, modifies)     /* name of the effect without which this one is nothing */                                      \
  F(words, channels)    /* force_x ... moment_z drive range gyro acc attitude */                                        \
  F(kind, kind)                                                                                                         \
  F(whole, n_parameters) F(whole, n_states)                                                                             \
  F(invariants, invariants)                                                                                             \
  F(about, about)                                                                                                       \
  F(feedback, feedback)                                                                                                 \
  F(hints, hints)                                                                                                       \
  F(number, rarity)     /* how often it is met, over others; 0: as often */                                             \
  F(words, needs)       /* what has to be recorded (ges.diagnose.library.requirements) */                               \
  F(words, requires_one_of) /* effects of which one has to be on for this one to act */                                 \
  F(text, family)       /* effects of one family act in one place */                                                    \
  F(text, settled)      /* why it enters no search */                                                                   \
  F(levels, carried)    /* levels at which it is tried together with what it modifies */

#define GES_FIELD(kind, name) ges_##kind name;
typedef struct {
  GES_PRIOR(GES_FIELD)
} ges_prior;
typedef struct {
  GES_EFFECT_PARAMETER(GES_FIELD)
} ges_effect_parameter;
typedef struct {
  GES_SEARCH(GES_FIELD)
} ges_search;

#endif
