/* Gusts by the Dryden spectra of MIL-F-8785C, low-altitude form: u and v along world x and y, w along world z.
 *
 * With h the height over ground in layers of 1000 ft, held within [0.01, 1]: L_w = h, L_u = L_v = h / (0.177 + 0.823 h)^1.2,
 * sigma_w = 0.1 W_20, sigma_u = sigma_v = sigma_w / (0.177 + 0.823 h)^0.4. H_u = sqrt(2 T_u) / (1 + T_u s) and
 * H_v,w = sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2 shape white noise of unit intensity, T = L / V, V the air speed but at least
 * a floor, so that a hovering vehicle meets gusts too. The noise is constant over STEP_S and depends on seed and time alone,
 * so the same gusts blow whatever the integrator, its step and the number of lanes. States: u; v and its lagged part; w and its.
 * Acts through every effect that reads the air velocity.
 */
#include "../core/random.h"
#include "effect.h"

#define STEP_S 0.01
#define ROOT_3 1.7320508075688772

static vd layer_share(const sample_t *s, const vd *p) { return clamp(s->agl / p[2], all_lanes(0.01), all_lanes(1.0)); }
static vd thinning(vd h) { return 0.177 + 0.823 * h; }

/* A stationary start: the variance that the filters keep. */
static void begin(const sample_t *s, const vd *p, vd *x) {
  stream_t draw = stream_at(p[1], all_lanes(-1.0));
  (void)s;
  x[0] = normal(&draw);
  for (int k = 1; k < 5; k += 2) {
    x[k] = 0.7071067811865476 * normal(&draw);
    x[k + 1] = 0.5 * x[k] + 0.35355339059327379 * normal(&draw);
  }
}

/* Rates of the filters; unit variance, the strength enters in blow(). */
static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)add;
  stream_t draw = stream_at(p[1], nearest(s->t / STEP_S - 0.49)); /* rounds down, a hair early */
  vd h = layer_share(s, p), speed = lane_max(lane_sqrt(s->air[0] * s->air[0] + s->air[1] * s->air[1] + s->air[2] * s->air[2]), p[3]);
  vd along = speed * lane_pow(thinning(h), all_lanes(1.2)) / (h * p[2]), rate[2] = {along, speed / (h * p[2])};
  dx[0] = -along * x[0] + lane_sqrt(2.0 * along / STEP_S) * normal(&draw);
  for (int k = 0; k < 2; k++) {
    int i = 1 + 2 * k;
    dx[i] = -rate[k] * x[i] + lane_sqrt(rate[k] / STEP_S) * normal(&draw);
    dx[i + 1] = rate[k] * (x[i] - x[i + 1]);
  }
}

static void blow(const sample_t *s, const vd *p, const vd *x, vd wind[3]) {
  vd up = 0.1 * p[0], level = up / lane_pow(thinning(layer_share(s, p)), all_lanes(0.4));
  wind[0] += level * x[0];
  wind[1] += level * (ROOT_3 * x[1] + (1.0 - ROOT_3) * x[2]);
  wind[2] += up * (ROOT_3 * x[3] + (1.0 - ROOT_3) * x[4]);
}

EFFECT(gusts) = {
    .name = "gusts",
    .title = "gusts with Dryden spectra",
    .equation = "W = sigma(h) H(s) white noise, T = L(h)/V",
    .latex = "W = \\sigma(h)\\, H(s)\\, \\text{white noise}, \\quad T = L(h) / V",
    .reference = "MIL-F-8785C, low altitude",
    .channels = "force_x force_y force_z",
    .kind = GES_WIND,
    .n_parameters = 4,
    .n_states = 5,
    .parameters =
        {
         {.name = "wind_20ft_m_s", .unit = "m/s", .role = GES_AMPLITUDE, .value = 6, .neutral = 0, .low = 0, .high = 40,
          .doc = "mean wind at 20 ft; sigma_w is a tenth of it"},
         {.name = "seed", .unit = "1", .role = GES_SWITCH, .value = 1, .neutral = NAN, .low = 0, .high = 4294967295.0,
          .doc = "which gusts"},
         {.name = "layer_m", .unit = "m", .role = GES_SWITCH, .value = 304.8, .neutral = NAN, .low = 1, .high = 2000,
          .doc = "depth of the surface layer (1000 ft)"},
         {.name = "least_speed_m_s", .unit = "m/s", .role = GES_SWITCH, .value = 1, .neutral = NAN, .low = 0.01, .high = 100,
          .doc = "least air speed at which the gusts go by"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_NONE,
    .needs = "attitude velocity",
    .hints = GES_RANDOM,
    .settled = "they push through drag, and none is known or found here",
    .begin = begin,
    .blow = blow,
    .wrench = wrench,
};
