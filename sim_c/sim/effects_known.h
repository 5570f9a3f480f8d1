/* All effects, by number: their descriptors, which are the same in every unit. */
#ifndef GES_EFFECTS_KNOWN_H
#define GES_EFFECTS_KNOWN_H

#include "../effects/effect.h"

#define X(name) extern const effect_t effect_##name##_r4_w1;
#include "../effects/effects.def"
#undef X

static const effect_t *const effects_known[] = {
#define X(name) &effect_##name##_r4_w1,
#include "../effects/effects.def"
#undef X
};
enum { N_EFFECTS = sizeof effects_known / sizeof *effects_known };

#endif
