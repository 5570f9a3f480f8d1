/* Index of every recorded column: C_t_s and so on; and the columns of the replay tables. */
#ifndef GES_COLUMNS_H
#define GES_COLUMNS_H

enum {
#define X(name, unit, value, doc) C_##name,
#include "columns.def"
#undef X
  N_COLUMNS
};

enum {
#define X(name, unit, doc) IN_##name,
#include "replay_in.def"
#undef X
  N_REPLAY_IN
};

enum {
#define X(name, unit, value, doc) OUT_##name,
#include "replay_out.def"
#undef X
  N_REPLAY_OUT
};

#endif
