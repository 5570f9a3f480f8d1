/* Laws: force and moment on the body, body frame, that stand in no effect's file but in the vehicle's own.
 *
 *   channel += coefficient * scale * product over groups of g^power |g|^magnitude * near
 *   near = exp(-((x - x_0)^2 + (y - y_0)^2) / (2 w^2)), or one where a term has no place of its own
 *
 * The scale is the weight m g or the thrust T of all rotors out of ground effect, of a moment times the arm L of the
 * rotors; groups.def lists the groups. Coefficients are plain numbers, and may differ from lane to lane; the terms are
 * those of the plan. References: v_h = sqrt(m g / (2 rho A)), the induced velocity of hover over the discs A of all
 * rotors (Leishman 2006, 2.15); w_h = sqrt(m g / (n k_T)), the rotor speed of hover; w_g = sqrt(g / L). */
#ifndef GES_LAW_H
#define GES_LAW_H

#include "effect.h"

enum {
#define X(quantity, reference, unit, needs, doc, expression) GROUP_##quantity,
#include "groups.def"
#undef X
  N_GROUPS
};

_Static_assert(N_GROUPS <= GES_MAX_GROUPS, "raise GES_MAX_GROUPS");

typedef struct {
  vd radius, arm, hover_inflow, hover_speed, body_rate; /* m, m, m/s, rad/s, rad/s */
} references_t;

typedef struct {
  int n;
  const ges_term *term; /* of the plan */
  vd coefficient[GES_MAX_TERMS];
  int uses[N_GROUPS];
} law_t;

static inline vd horizontal_squared(const sample_t *s) {
  vd x = s->v[0] - s->wind[0], y = s->v[1] - s->wind[1];
  return x * x + y * y;
}

static inline references_t references_of(const sample_t *s) {
  references_t l;
  vd arm = all_lanes(0.0), disc = all_lanes(0.0), weight = s->mass * s->gravity;
  for (int i = 0; i < ROTORS_OF(s); i++) {
    arm += lane_sqrt(s->hub[i][0] * s->hub[i][0] + s->hub[i][1] * s->hub[i][1]);
    disc += PI * (s->radius[i] * s->radius[i]);
  }
  l.radius = mean(s, s->radius);
  l.arm = arm / ROTORS_OF(s);
  l.hover_inflow = lane_sqrt(weight / (2.0 * s->rho * disc));
  l.hover_speed = lane_sqrt(weight / (ROTORS_OF(s) * s->thrust_coefficient));
  l.body_rate = lane_sqrt(s->gravity / l.arm);
  return l;
}

/* Those of the groups that some term uses. */
static inline void groups_of(const law_t *law, const references_t *l, const sample_t *s, vd group[N_GROUPS]) {
#define X(quantity, reference, unit, needs, doc, expression) \
  if (law->uses[GROUP_##quantity]) group[GROUP_##quantity] = expression;
#include "groups.def"
#undef X
}

static inline vd term_product(const ges_term *term, vd product, const vd group[N_GROUPS]) {
  for (int k = 0; k < N_GROUPS; k++) {
    for (int i = 0; i < term->power[k]; i++) product *= group[k];
    for (int i = 0; i < term->magnitude[k]; i++) product *= lane_abs(group[k]);
  }
  return product;
}

/* How much a term acts at a place, a radial basis function (Broomhead and Lowe 1988, Complex Systems 2, 321). */
static inline vd nearness(const ges_term *term, const sample_t *s) {
  vd x = s->p[0] - term->near_m[0], y = s->p[1] - term->near_m[1];
  return lane_exp((-0.5 / (term->near_m[2] * term->near_m[2])) * (x * x + y * y));
}

static inline void add_law(const law_t *law, const sample_t *s, wrench_t *add) {
  if (law->n == 0) return;
  references_t l = references_of(s);
  vd group[N_GROUPS], scale[2] = {s->mass * s->gravity, total(s, s->thrust)};
  groups_of(law, &l, s, group);
  for (int j = 0; j < law->n; j++) {
    const ges_term *term = &law->term[j];
    vd value = term_product(term, law->coefficient[j] * scale[term->scale], group);
    if (term->near_m[2] > 0.0) value *= nearness(term, s);
    if (term->channel < 3) add->force[term->channel] += value;
    else add->moment[term->channel - 3] += value * l.arm;
  }
}

#endif
