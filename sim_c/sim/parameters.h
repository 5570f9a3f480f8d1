/* Index of every named number of a flight in its flat table: P_mass_kg and so on. */
#ifndef GES_PARAMETERS_H
#define GES_PARAMETERS_H

#include "../include/ges.h"

enum {
#define X(name, unit, value, low, high, doc) P_##name,
#include "params.def"
#undef X
  N_PARAMETERS
};

#endif
