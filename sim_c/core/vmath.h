/* Elementary functions over lanes from + - * / and bit operations alone: the same bits on every machine.
 *
 * exp: argument reduction to |r| <= ln2/2, Taylor polynomial of degree 13 (error below 2 ulp).
 * log: m in [sqrt(1/2), sqrt(2)), 2 artanh((m-1)/(m+1)) as an odd series (Abramowitz & Stegun 4.1.27).
 * acos: polynomial of degree 7 times sqrt(1 - |x|) (Abramowitz & Stegun 4.4.46, error below 2e-8).
 * sin, cos: reduction by multiples of pi/2 (Cody & Waite), Taylor polynomials of degree 15 and 16.
 */
#ifndef GES_VMATH_H
#define GES_VMATH_H

#include "lanes.h"

#define PI 3.141592653589793
#define LN2_HIGH 6.93147180369123816490e-01
#define LN2_LOW 1.90821492927058770002e-10

/* 2^k for integer-valued k in [-1022, 1023]. */
static inline vd power_of_two(vd k) {
  vu biased = bits_of(k + (1023.0 + MAGIC_ROUND));
  return from_bits(biased << 52);
}

static inline vd lane_exp(vd x) {
  static const double c[] = {1.6059043836821613e-10, 2.08767569878681e-09, 2.505210838544172e-08,
                             2.7557319223985893e-07, 2.7557319223985893e-06, 2.48015873015873e-05,
                             1.984126984126984e-04,  1.388888888888889e-03,  8.333333333333333e-03,
                             4.1666666666666664e-02, 1.6666666666666666e-01, 0.5, 1.0, 1.0};
  x = clamp(x, all_lanes(-700.0), all_lanes(700.0));
  vd k = nearest(x * 1.4426950408889634);
  vd r = (x - k * LN2_HIGH) - k * LN2_LOW;
  vd p = all_lanes(c[0]);
  for (int i = 1; i < 14; i++) p = p * r + c[i];
  return p * power_of_two(k);
}

/* Natural logarithm of a positive, normal number. */
static inline vd lane_log(vd x) {
  vu b = bits_of(x);
  vu shifted = b - 0x3fe6a09e667f3bcdULL; /* bits of sqrt(1/2) */
  vu exponent = (shifted >> 52) << 52;
  vd m = from_bits(b - exponent);
  vu biased = ((shifted >> 52) + 1024) & 0xfff; /* k + 1024, without a sign */
  vd k = from_bits(biased | 0x4330000000000000ULL) - (4503599627370496.0 + 1024.0);
  vd s = (m - 1.0) / (m + 1.0), s2 = s * s;
  vd p = all_lanes(1.0 / 19.0);
  for (int n = 17; n >= 3; n -= 2) p = p * s2 + 1.0 / (double)n;
  return k * LN2_HIGH + (k * LN2_LOW + (2.0 * s + 2.0 * s * s2 * p));
}

/* x^y for x > 0. */
static inline vd lane_pow(vd x, vd y) { return lane_exp(y * lane_log(x)); }

/* Arc cosine; beyond -1 and 1 as of these. */
static inline vd lane_acos(vd x) {
  static const double c[] = {-0.0012624911, 0.0066700901, -0.0170881256, 0.0308918810,
                             -0.0501743046, 0.0889789874, -0.2145988016, 1.5707963050};
  vd size = lane_min(lane_max(x, -x), all_lanes(1.0));
  vd p = all_lanes(c[0]);
  for (int i = 1; i < 8; i++) p = p * size + c[i];
  p = p * lane_sqrt(1.0 - size);
  return sel(LT(x, all_lanes(0.0)), PI - p, p);
}

static inline void lane_sin_cos(vd x, vd *sine, vd *cosine) {
  vd k = nearest(x * 0.6366197723675814);
  vd r = ((x - k * 1.57079632673412561417e+00) - k * 6.07710050630396597660e-11) - k * 2.02226624879595063154e-21;
  vd r2 = r * r;
  vd s = r + r * r2 * (-1.6666666666666666e-01 + r2 * (8.333333333333333e-03 + r2 * (-1.984126984126984e-04 +
         r2 * (2.7557319223985893e-06 + r2 * (-2.505210838544172e-08 + r2 * (1.6059043836821613e-10 - r2 * 7.647163731819816e-13))))));
  vd c = 1.0 + r2 * (-0.5 + r2 * (4.1666666666666664e-02 + r2 * (-1.388888888888889e-03 + r2 * (2.48015873015873e-05 +
         r2 * (-2.7557319223985893e-07 + r2 * (2.08767569878681e-09 - r2 * 1.1470745597729725e-11))))));
  vd half = k * 0.5, quarter = k * 0.25;
  vl odd = NE(half, nearest(half));
  vd base = k - 4.0 * nearest(quarter - 0.375); /* quadrant 0..3 */
  vl sine_negative = GT(base, all_lanes(1.5));
  vl cosine_negative = GT(base, all_lanes(0.5)) & LT(base, all_lanes(2.5));
  vd a = sel(odd, c, s), b = sel(odd, s, c);
  *sine = sel(sine_negative, -a, a);
  *cosine = sel(cosine_negative, -b, b);
}

#endif
