/* Index of every recorded column: C_t_s and so on, of a rotor's that of the first rotor, whose places for all follow. And the
 * columns of the replay tables: those of no rotor, then, for each of IN_rotor_speed_ and so on, one for every rotor. */
#ifndef GES_COLUMNS_H
#define GES_COLUMNS_H

#include "../include/ges.h"

enum {
#define X(name, unit, value, doc) C_##name,
#define XR(name, suffix, unit, value, doc) C_##name, C_##name##last = C_##name + GES_MAX_ROTORS - 1,
#include "columns.def"
#undef X
#undef XR
  N_COLUMNS
};

#define NOTHING(...)
enum {
#define X(name, unit, doc) IN_##name,
#define XR NOTHING
#include "replay_in.def"
#undef X
#undef XR
  N_REPLAY_IN
};

enum {
#define X NOTHING
#define XR(name, suffix, unit, doc) IN_##name,
#include "replay_in.def"
#undef X
#undef XR
  N_REPLAY_IN_ROTOR
};

enum {
#define X(name, unit, value, doc) OUT_##name,
#define XR NOTHING
#include "replay_out.def"
#undef X
#undef XR
  N_REPLAY_OUT
};

enum {
#define X NOTHING
#define XR(name, suffix, unit, value, doc) OUT_##name,
#include "replay_out.def"
#undef X
#undef XR
  N_REPLAY_OUT_ROTOR
};
#undef NOTHING

#endif
