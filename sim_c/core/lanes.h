/* Lanes: one vector per variable, one lane per flight (or per recorded sample).
 *
 * GES_W is the number of lanes a translation unit is compiled for, GES_ROTORS that of rotors (effects/effect.h). All arithmetic on `vd` reads like
 * scalar code; comparisons give masks (all bits set or none) for sel(). Only + - * / and sqrt are used, which
 * IEEE 754 rounds correctly, so every lane has the same bits whatever GES_W and the machine's vector width
 * (compile with -ffp-contract=off and without -ffast-math).
 */
#ifndef GES_LANES_H
#define GES_LANES_H

#include <stdint.h>
#include <string.h>

#ifndef GES_W
#error "define GES_W, the number of lanes, before lanes.h"
#endif

#ifndef GES_ROTORS
#define GES_ROTORS 4
#endif

#define GES_PASTE_(a, b, c) a##_r##b##_w##c
#define GES_PASTE(a, b, c) GES_PASTE_(a, b, c)
/* Name of a symbol that exists once per number of rotors and lane width. */
#define PER_UNIT(name) GES_PASTE(name, GES_ROTORS, GES_W)

#define MAGIC_ROUND 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to the nearest integer */

/* `vr`, a vector of GES_WIDE doubles: one rotor of every lane, the same as a vd. One flight alone has no other lanes to fill a
 * vector with: there, GES_ABREAST of its rotors stand side by side in a vr, for arithmetic that all of them go through alike.
 * Arrays over rotors hold a multiple of that many. */
#if GES_W > 1
#define GES_ABREAST 1
#define GES_WIDE GES_W
#else
#if defined(__AVX__) && GES_ROTORS % 4 == 0
#define GES_ABREAST 4
#else
#define GES_ABREAST 2
#endif
#define GES_WIDE GES_ABREAST
#endif
typedef double vr __attribute__((vector_size(8 * GES_WIDE)));

/* GCC's own names of the instructions: parsing immintrin.h takes four fifths of the time of a build. */
#if defined(__clang__) && (defined(__AVX512DQ__) || defined(__AVX__)) && GES_WIDE >= 4
#include <immintrin.h>
#endif
#if defined(__AVX512F__) && defined(__AVX512DQ__) && GES_WIDE == 8
/* A bit a lane, as the processor has them. */
typedef uint8_t vrl;
static inline int wide_any(vrl mask) { return mask != 0; }
#ifdef __clang__
#define COMPARE(a, b, predicate) ((vrl)_mm512_cmp_pd_mask((__m512d)(a), (__m512d)(b), predicate))
static inline vr wide_sel(vrl mask, vr a, vr b) { return (vr)_mm512_mask_blend_pd(mask, (__m512d)b, (__m512d)a); }
static inline vr wide_sqrt(vr x) { return (vr)_mm512_sqrt_pd((__m512d)x); }
static inline vr wide_min(vr a, vr b) { return (vr)_mm512_min_pd((__m512d)a, (__m512d)b); }
static inline vr wide_max(vr a, vr b) { return (vr)_mm512_max_pd((__m512d)a, (__m512d)b); }
#else
#define COMPARE(a, b, predicate) ((vrl)__builtin_ia32_cmppd512_mask(a, b, predicate, -1, 4))
static inline vr wide_sel(vrl mask, vr a, vr b) { return __builtin_ia32_blendmpd_512_mask(b, a, mask); }
/* all lanes, rounded as is set (4) */
static inline vr wide_sqrt(vr x) { return __builtin_ia32_sqrtpd512_mask(x, x, -1, 4); }
static inline vr wide_min(vr a, vr b) { return __builtin_ia32_minpd512_mask(a, b, a, -1, 4); }
static inline vr wide_max(vr a, vr b) { return __builtin_ia32_maxpd512_mask(a, b, a, -1, 4); }
#endif
#else
typedef int64_t vrl __attribute__((vector_size(8 * GES_WIDE)));
#if defined(__AVX__) && GES_WIDE == 4
#ifdef __clang__
static inline vr wide_sel(vrl mask, vr a, vr b) { return (vr)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)mask); }
static inline int wide_any(vrl mask) { return _mm256_movemask_pd((__m256d)mask) != 0; }
static inline vr wide_sqrt(vr x) { return (vr)_mm256_sqrt_pd((__m256d)x); }
static inline vr wide_min(vr a, vr b) { return (vr)_mm256_min_pd((__m256d)a, (__m256d)b); }
static inline vr wide_max(vr a, vr b) { return (vr)_mm256_max_pd((__m256d)a, (__m256d)b); }
#else
static inline vr wide_sel(vrl mask, vr a, vr b) { return __builtin_ia32_blendvpd256(b, a, (vr)mask); }
static inline int wide_any(vrl mask) { return __builtin_ia32_movmskpd256((vr)mask) != 0; }
static inline vr wide_sqrt(vr x) { return __builtin_ia32_sqrtpd256(x); }
static inline vr wide_min(vr a, vr b) { return __builtin_ia32_minpd256(a, b); }
static inline vr wide_max(vr a, vr b) { return __builtin_ia32_maxpd256(a, b); }
#endif
#else
static inline vr wide_sel(vrl mask, vr a, vr b) { return (vr)(((vrl)a & mask) | ((vrl)b & ~mask)); }
static inline int wide_any(vrl mask) {
  int64_t all = 0;
  for (int i = 0; i < GES_WIDE; i++) all |= mask[i];
  return all != 0;
}
#if defined(__SSE2__) && GES_WIDE == 2 && !defined(__clang__)
static inline vr wide_sqrt(vr x) { return __builtin_ia32_sqrtpd(x); }
static inline vr wide_min(vr a, vr b) { return __builtin_ia32_minpd(a, b); }
static inline vr wide_max(vr a, vr b) { return __builtin_ia32_maxpd(a, b); }
#else
static inline vr wide_sqrt(vr x) {
  for (int i = 0; i < GES_WIDE; i++) x[i] = __builtin_sqrt(x[i]);
  return x;
}
/* of two zeros, and where one is NaN, the second, as the processor's own instructions have it */
static inline vr wide_min(vr a, vr b) { return wide_sel(a < b, a, b); }
static inline vr wide_max(vr a, vr b) { return wide_sel(a > b, a, b); }
#endif
#endif
#endif

#if GES_W == 1
typedef double vd;
typedef int64_t vl;
typedef uint64_t vu;
typedef float vf;
static inline double lane(vd v, int i) { (void)i; return v; }
static inline void set_lane(vd *v, int i, double x) { (void)i; *v = x; }
static inline vd sel(vl mask, vd a, vd b) { return mask ? a : b; }
static inline int any(vl mask) { return mask != 0; }
static inline vf to_float(vd v) { return (vf)v; }
static inline vd to_double(vf v) { return (vd)v; }
static inline vd lane_sqrt(vd x) { return __builtin_sqrt(x); }
static inline vd lane_min(vd a, vd b) { return a < b ? a : b; }
static inline vd lane_max(vd a, vd b) { return a > b ? a : b; }
#else
typedef vr vd;
typedef vrl vl;
typedef uint64_t vu __attribute__((vector_size(8 * GES_W)));
typedef float vf __attribute__((vector_size(4 * GES_W)));
static inline double lane(vd v, int i) { return v[i]; }
static inline void set_lane(vd *v, int i, double x) { (*v)[i] = x; }
static inline vd sel(vl mask, vd a, vd b) { return wide_sel(mask, a, b); }
static inline int any(vl mask) { return wide_any(mask); }
static inline vf to_float(vd v) { return __builtin_convertvector(v, vf); }
static inline vd to_double(vf v) { return __builtin_convertvector(v, vd); }
static inline vd lane_sqrt(vd x) { return wide_sqrt(x); }
static inline vd lane_min(vd a, vd b) { return wide_min(a, b); }
static inline vd lane_max(vd a, vd b) { return wide_max(a, b); }
#endif

/* For the innermost functions, whose results should stay in registers. */
#define INNER static inline __attribute__((always_inline))

/* Comparisons, lane by lane. */
#if defined(COMPARE)
#define EQ(a, b) COMPARE(a, b, 0)
#define LT(a, b) COMPARE(a, b, 1)
#define LE(a, b) COMPARE(a, b, 2)
#define NE(a, b) COMPARE(a, b, 4)
#elif GES_W == 1
#define EQ(a, b) (-(vl)((a) == (b)))
#define LT(a, b) (-(vl)((a) < (b)))
#define LE(a, b) (-(vl)((a) <= (b)))
#define NE(a, b) (-(vl)((a) != (b)))
#else
#define EQ(a, b) ((a) == (b))
#define LT(a, b) ((a) < (b))
#define LE(a, b) ((a) <= (b))
#define NE(a, b) ((a) != (b))
#endif
#define GT(a, b) LT(b, a)
#define GE(a, b) LE(b, a)

static inline vd all_lanes(double x) { return x - (vd){0}; }
INNER void clear(vd *x, int n) {
  for (int i = 0; i < n; i++) x[i] = all_lanes(0.0);
}
static inline vu bits_of(vd v) { vu b; memcpy(&b, &v, sizeof b); return b; }
static inline vd from_bits(vu b) { vd v; memcpy(&v, &b, sizeof v); return v; }
static inline vd clamp(vd x, vd low, vd high) { return lane_min(lane_max(x, low), high); }
static inline vd lane_abs(vd x) { return from_bits(bits_of(x) & 0x7fffffffffffffffULL); }
/* Nearest integer, halves to even; |x| < 2^51. */
static inline vd nearest(vd x) { return (x + MAGIC_ROUND) - MAGIC_ROUND; }
static inline vr wide_nearest(vr x) { return (x + MAGIC_ROUND) - MAGIC_ROUND; }

/* Between vd and vr. all_rotors: what all rotors share, set_rotors: the same, given for lane i; rotors_from, put_rotors: as many
 * rotors of an array as a vr holds; rotor, set_rotor: number j of them; wide_pick: what a lane chooses for all its rotors. */
#if GES_W == 1
#define WIDE_GE(a, b) ((a) >= (b))
static inline vr all_rotors(vd x) { return x - (vr){0}; }
static inline void set_rotors(vr *v, int i, double x) { (void)i; *v = all_rotors(x); }
static inline vr rotors_from(const vd *first) { vr v; memcpy(&v, first, sizeof v); return v; }
static inline void put_rotors(vd *first, vr v) { memcpy(first, &v, sizeof v); }
static inline vd rotor(vr v, int j) { return v[j]; }
static inline void set_rotor(vr *v, int j, vd x) { (*v)[j] = x; }
static inline vr wide_pick(vl mask, vr a, vr b) { return mask ? a : b; }
#else
#define WIDE_GE(a, b) GE(a, b)
static inline vr all_rotors(vd x) { return x; }
static inline void set_rotors(vr *v, int i, double x) { (*v)[i] = x; }
static inline vr rotors_from(const vd *first) { return *first; }
static inline void put_rotors(vd *first, vr v) { *first = v; }
static inline vd rotor(vr v, int j) { (void)j; return v; }
static inline void set_rotor(vr *v, int j, vd x) { (void)j; *v = x; }
static inline vr wide_pick(vl mask, vr a, vr b) { return sel(mask, a, b); }
#endif

#endif
