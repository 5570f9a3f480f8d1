/* Moments of inertia off by constant shares: I_k = (1 + s_k) I_k,declared. */
#include "effect.h"

static void adjust(sample_t *s, const vd *p) {
  for (int k = 0; k < 3; k++) s->inertia[k] = s->inertia[k] * (1.0 + p[k]);
}

EFFECT(inertia) = {
    .name = "inertia",
    .title = "moments of inertia other than declared",
    .equation = "I = (1 + s) I_declared",
    .reference = "definition",
    .channels = "moment_x moment_y moment_z",
    .kind = GES_PARAMETER,
    .n_parameters = 3,
    .parameters = {{"xx", "1", "relative change about x", 0.2, 0, -0.7, 3},
                   {"yy", "1", "relative change about y", 0.2, 0, -0.7, 3},
                   {"zz", "1", "relative change about z", 0.2, 0, -0.7, 3}},
    .adjust = adjust,
};
