/* The number type of the firmware: float on a flight controller, a vector of floats when one core simulates
 * FIRMWARE_LANES vehicles at once. Every operation below exists for both. */
#ifndef GES_FIRMWARE_REAL_H
#define GES_FIRMWARE_REAL_H

#include <stdint.h>

#ifndef FIRMWARE_LANES
#define FIRMWARE_LANES 1
#endif

#define FIRMWARE_MAX_ROTORS 16
#ifndef FIRMWARE_ROTORS
#define FIRMWARE_ROTORS 4 /* or 6, 8; 16: as many as its configuration says */
#endif
#if FIRMWARE_ROTORS == FIRMWARE_MAX_ROTORS
#define FIRMWARE_ROTORS_OF(c) ((c)->rotors)
#else
#define FIRMWARE_ROTORS_OF(c) ((void)(c), FIRMWARE_ROTORS)
#endif

/* Functions that exist once per number of rotors and lanes; on a flight controller they keep their plain names. */
#define FIRMWARE_PASTE_(name, rotors, lanes) name##_r##rotors##_w##lanes
#define FIRMWARE_PASTE(name) FIRMWARE_PASTE_3(name, FIRMWARE_ROTORS, FIRMWARE_LANES)
#define FIRMWARE_PASTE_3(name, rotors, lanes) FIRMWARE_PASTE_(name, rotors, lanes)
#if FIRMWARE_LANES > 1 || FIRMWARE_ROTORS != 4
#define firmware_run FIRMWARE_PASTE(firmware_run)
#define ge_ff_estimate FIRMWARE_PASTE(ge_ff_estimate)
#define ge_ff_scale FIRMWARE_PASTE(ge_ff_scale)
#define ge_ff_runs_network FIRMWARE_PASTE(ge_ff_runs_network)
#define ge_ff_network FIRMWARE_PASTE(ge_ff_network)
#define ge_ff_network_is_sound FIRMWARE_PASTE(ge_ff_network_is_sound)
#endif

#if FIRMWARE_LANES == 1
typedef float real;
typedef int32_t choice;
#define WHEN(condition) (-(choice)(condition))
static inline real pick(choice mask, real a, real b) { return mask ? a : b; }
static inline int some(choice mask) { return mask != 0; }
static inline real root(real x) { return __builtin_sqrtf(x); }
#else
typedef float real __attribute__((vector_size(4 * FIRMWARE_LANES)));
typedef int32_t choice __attribute__((vector_size(4 * FIRMWARE_LANES)));
#define WHEN(condition) (condition)
static inline real pick(choice mask, real a, real b) { return (real)(((choice)a & mask) | ((choice)b & ~mask)); }
static inline int some(choice mask) {
  int32_t all = 0;
  for (int i = 0; i < FIRMWARE_LANES; i++) all |= mask[i];
  return all != 0;
}
static inline real root(real x) {
  for (int i = 0; i < FIRMWARE_LANES; i++) x[i] = __builtin_sqrtf(x[i]);
  return x;
}
#endif

static inline real number(float x) { return x - (real){0}; }
static inline real least(real a, real b) { return pick(WHEN(a < b), a, b); }
static inline real greatest(real a, real b) { return pick(WHEN(a > b), a, b); }
static inline real within(real x, real low, real high) { return least(greatest(x, low), high); }

#endif
