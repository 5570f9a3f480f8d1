/* Thrust gain of a rotor near the ground.
 *
 * T_i = K_T w_i^2 f_i,  f_i = 1 + a (f(x_i) - 1) cos(slope)^n (1 + c kappa), clamped to [low, high];
 * x_i = (height of the hub + offset) / R_i, kappa the Laplacian of the ground (1/m, positive in hollows). Forms f(x):
 *   0 Cheeseman & Bennett 1955 (ARC R&M 3021):  1 / (1 - u), u = (1/4x)^2, x held above 0.26 (pole at 1/4)
 *   1 Hayden 1976:  (A + B (2/x)^2)^(2/3), A = 0.9926, B = 0.0379; below 1 taken as 1
 *   2 Sanchez-Cuevas, Heredia & Ollero 2017:  image sources of all rotors with the body lift K_b,
 *       1/f = 1 - u - sum_j x/2 / (d_j^2 + 4x^2)^1.5 - 2 K_b x / (b^2 + 4x^2)^1.5, d_j the distances of the other hubs
 *       over R, b the greatest (the opposite rotor)
 *   3 He & Leang 2020:  1 + C_a exp(-C_b x)
 *   4 rational:  1 + C_a / (1 + (C_b x)^2): flat at the ground, where measured gains level off, and falling as x^-2, as images do
 * The slope exponent, the curvature gain and the clamp are the study's heuristics, without external support.
 * Valid: hover-like flight, x >= 0.5. Cheeseman-Bennett is a ratio at constant power, used here at constant rotor
 * speed: the amplitude a takes up the difference.
 */
#include "effect.h"

enum { FORM, AMPLITUDE, SLOPE_EXPONENT, CURVATURE_GAIN, LOW, HIGH, CA, DECAY, KB, OFFSET };

static vd hayden(vd x) {
  vd two = 2.0 / lane_max(x, all_lanes(0.1));
  return lane_max(lane_pow(0.9926 + 0.0379 * (two * two), all_lanes(2.0 / 3.0)), all_lanes(1.0));
}

static vd inverse_three_halves(vd x) { return 1.0 / (x * lane_sqrt(x)); }

/* Images of all rotors: x/2 / (d^2 + 4 x^2)^1.5 of one at the distance d R, which is (1/4x)^2 of the rotor itself. */
static vd sanchez_cuevas(const sample_t *s, int i, vd x, vd kb) {
  vd quarter = 0.25 / lane_max(x, all_lanes(0.26)), four = 4.0 * x * x, opposite = all_lanes(0.0), images = quarter * quarter;
  for (int j = 0; j < ROTORS_OF(s); j++) {
    if (j == i) continue;
    vd a = s->hub[i][0] - s->hub[j][0], b = s->hub[i][1] - s->hub[j][1];
    vd square = (a * a + b * b) / (s->radius[i] * s->radius[i]);
    images += 0.5 * x * inverse_three_halves(square + four);
    opposite = lane_max(opposite, square);
  }
  return 1.0 / lane_max(1.0 - images - 2.0 * kb * x * inverse_three_halves(opposite + four), all_lanes(0.2));
}

/* f - 1 of rotors as a fraction, so that one division serves the form and the slope. */
typedef struct {
  vr over, under;
} fraction_t;

/* 1/(1-u) - 1 = (R/4)^2 / (h^2 - (R/4)^2), h held above 0.26 R. */
static fraction_t cheeseman_bennett(vr height, vr radius) {
  vr quarter = 0.25 * radius, h = wide_max(height, 0.26 * radius);
  return (fraction_t){quarter * quarter, h * h - quarter * quarter};
}

static vd other_form(const sample_t *s, const vd *p, int i) {
  vd x = (s->height[i] + p[OFFSET]) / s->radius[i];
  vd f = hayden(x);
  f = sel(GT(p[FORM], all_lanes(1.5)), sanchez_cuevas(s, i, x, p[KB]), f);
  f = sel(GT(p[FORM], all_lanes(2.5)), 1.0 + p[CA] * lane_exp(-p[DECAY] * x), f);
  vd k = p[DECAY] * x;
  return sel(GT(p[FORM], all_lanes(3.5)), 1.0 + p[CA] / (1.0 + k * k), f);
}

static fraction_t gain(const sample_t *s, const vd *p, int i) {
  fraction_t g = cheeseman_bennett(rotors_from(s->height + i) + p[OFFSET], rotors_from(s->radius + i));
  vl other = GT(p[FORM], all_lanes(0.5));
  if (any(other)) {
    vr f = g.over;
    for (int j = 0; j < GES_ABREAST; j++) set_rotor(&f, j, other_form(s, p, i + j));
    g.over = wide_pick(other, f - 1.0, g.over);
    g.under = wide_pick(other, all_rotors(all_lanes(1.0)), g.under);
  }
  return g;
}

/* 1 / cos(slope)^n; the usual exponents 0, 1, 2 without a general power. */
static vr inverse_slope_factor(vr gx, vr gy, vd n) {
  vr square = 1.0 + gx * gx + gy * gy, power = square;
  vl one = EQ(n, all_lanes(1.0)), two = EQ(n, all_lanes(2.0)), zero = EQ(n, all_lanes(0.0));
  vr f = wide_pick(one, wide_sqrt(square), wide_pick(two, square, all_rotors(all_lanes(1.0))));
  vl usual = one | two | zero;
  if (!any(~usual)) return f;
  for (int j = 0; j < GES_ABREAST; j++) set_rotor(&power, j, lane_pow(rotor(square, j), 0.5 * n));
  return wide_pick(usual, f, power);
}

static void thrust_gain(const sample_t *s, const vd *p, vd thrust_gain[GES_ROTORS]) {
  for (int i = 0; i < ROTORS_OF(s); i += GES_ABREAST) {
    fraction_t f = gain(s, p, i);
    vr corrected = p[AMPLITUDE] * f.over * (1.0 + p[CURVATURE_GAIN] * rotors_from(s->under.laplacian + i));
    vr slope = inverse_slope_factor(rotors_from(s->under.gx + i), rotors_from(s->under.gy + i), p[SLOPE_EXPONENT]);
    vr above_low = wide_max(corrected / (f.under * slope), all_rotors(p[LOW] - 1.0));
    put_rotors(thrust_gain + i, wide_min(above_low, all_rotors(p[HIGH] - 1.0)));
  }
}

static void ground(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  (void)p, (void)x, (void)dx;
  for (int i = 0; i < ROTORS_OF(s); i++) add->thrust[i] += s->thrust[i] * s->thrust_gain[i];
}

EFFECT(ground_effect) = {
    .name = "ground_effect",
    .title = "thrust gain near the ground",
    .equation = "T_i = K_T w_i^2 [1 + a (f(x_i) - 1) cos(slope)^n (1 + c kappa)], x = z/R",
    .latex = "T_i = K_T\\, \\Omega_i^2\\, [1 + a\\, (f(x_i) - 1) \\cos^n(\\text{slope})\\, (1 + c\\, \\kappa)], "
             "\\quad x = z/R",
    .reference = "Cheeseman & Bennett 1955; Hayden 1976; Sanchez-Cuevas et al. 2017; He & Leang 2020",
    .channels = "force_z moment_x moment_y",
    .kind = GES_WRENCH,
    .n_parameters = 10,
    .invariants = GES_INVARIANT_MIRROR | GES_INVARIANT_FADES,
    .parameters =
        {
         {.name = "form", .unit = "1", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = 0, .high = 4,
          .doc = "0 Cheeseman-Bennett, 1 Hayden, 2 Sanchez-Cuevas, 3 exponential, 4 rational"},
         {.name = "amplitude", .unit = "1", .role = GES_AMPLITUDE, .value = 1, .neutral = 0, .low = 0, .high = 12,
          .doc = "scales f - 1", .plausible = 4.0},
         {.name = "slope_exponent", .unit = "1", .role = GES_SWITCH, .value = 1, .neutral = NAN, .low = 0, .high = 4,
          .doc = "exponent of the cosine of the slope"},
         {.name = "curvature_gain_m", .unit = "m", .role = GES_SWITCH, .value = 0, .neutral = NAN, .low = -5, .high = 5,
          .doc = "change of the gain per curvature"},
         {.name = "low", .unit = "1", .role = GES_SWITCH, .value = 0.5, .neutral = NAN, .low = 0, .high = 1,
          .doc = "least factor"},
         {.name = "high", .unit = "1", .role = GES_SHAPE, .value = 1.8, .neutral = NAN, .low = 1, .high = 10,
          .doc = "greatest factor"},
         {.name = "c_a", .unit = "1", .role = GES_AMPLITUDE, .value = 0.4, .neutral = NAN, .low = 0, .high = 2,
          .doc = "exponential and rational form: gain at the ground", .plausible = 0.7},
         {.name = "decay", .unit = "1", .role = GES_SHAPE, .value = 1.5, .neutral = NAN, .low = 0.3, .high = 5,
          .doc = "exponential and rational form: decay per radius", .usual = 1.0, .usual_sd = 1.0, .fitted = 1,
          .acts_above = {"form", 2.5}},
         {.name = "k_b", .unit = "1", .role = GES_SWITCH, .value = 2, .neutral = NAN, .low = 0, .high = 5,
          .doc = "Sanchez-Cuevas form: body lift"},
         {.name = "rotor_plane_offset_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "rotor plane above where the vehicle file puts it", .fitted = 1, .corrects = "rotors.z_m"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_THRUST_GAIN,
    .needs = "height",
    .hints = GES_OWN_LEVER,
    .family = "lift near the ground",
    .search =
        {
         {.amplitudes = "c_a", .fixed = {{"form", 3}, {"amplitude", 1}, {"high", 10}}, .axis = "decay",
          .levels = LEVELS(0.35, 0.5, 0.75, 1.1, 1.6, 2.6)},
         {.amplitudes = "c_a", .fixed = {{"form", 4}, {"amplitude", 1}, {"high", 10}}, .axis = "decay",
          .levels = LEVELS(0.4, 0.6, 0.9, 1.4)},
         {.amplitudes = "amplitude", .fixed = {{"high", 10}}, .axis = "form", .levels = LEVELS(0, 1, 2),
          .across = "rotor_plane_offset_m"},
         {.amplitudes = "c_a", .fixed = {{"form", 3}, {"amplitude", 1}, {"high", 10}}, .axis = "decay",
          .levels = LEVELS(0.35), .modified = 1},
         {.amplitudes = "c_a", .fixed = {{"form", 4}, {"amplitude", 1}, {"high", 10}}, .axis = "decay",
          .levels = LEVELS(0.4, 0.6, 0.9), .modified = 1},
        },
    .thrust_gain = thrust_gain,
    .ground = ground,
};
