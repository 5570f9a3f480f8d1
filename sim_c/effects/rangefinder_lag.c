/* Rangefinder behind a first-order filter: tau dx/dt = h - x, reading x. Backward Euler over the sampling time. */
#include "effect.h"

static void sense(const sample_t *s, const vd *p, vd *x, reading_t *add) {
  vd known = lane_max(s->range, all_lanes(-1e30)); /* NaN readings leave the filter alone */
  vl good = EQ(s->range, s->range);
  vl fresh = EQ(x[1], all_lanes(0.0));
  vd start = sel(fresh, known, x[0]);
  vd next = start + (known - start) * (s->dt / (s->dt + lane_max(p[0], all_lanes(1e-9))));
  x[0] = sel(good, next, x[0]);
  x[1] = sel(good, all_lanes(1.0), x[1]);
  add->range += sel(good & GT(p[0], all_lanes(0.0)), x[0] - s->range, all_lanes(0.0));
}

EFFECT(rangefinder_lag) = {
    .name = "rangefinder_lag",
    .title = "rangefinder lags behind",
    .equation = "tau dy/dt = h - y",
    .latex = "\\tau \\frac{dy}{dt} = h - y",
    .reference = "first-order filter",
    .channels = "range",
    .kind = GES_SENSOR,
    .n_parameters = 1,
    .n_states = 2,
    .parameters =
        {
         {.name = "tau_s", .unit = "s", .role = GES_AMPLITUDE, .value = 0.05, .neutral = 0, .low = 0, .high = 1,
          .doc = "time constant", .prior = {.shows_in = "range", .step = 0.005, .sd = 0.015}},
        },
    .about = GES_FAULT,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "range smooth_ground",
    .search =
        {
         {.amplitudes = "tau_s", .rule = "levels", .levels = LEVELS(0.05, 0.12, 0.3)},
        },
    .sense = sense,
};
