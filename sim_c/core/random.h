/* Random numbers from integers alone: the same bits on every machine and for every number of lanes.
 *
 * xorshift32 (Marsaglia 2003) lays out terrain; xorshift128+ (Vigna 2017), one stream a lane and purpose, drives
 * the sensor noise; splitmix64 (Steele, Lea & Flood 2014) turns a seed into a stream's state.
 */
#ifndef GES_RANDOM_H
#define GES_RANDOM_H

#include "lanes.h"

static inline uint32_t xorshift32(uint32_t *state) {
  uint32_t x = *state;
  x ^= x << 13;
  x ^= x >> 17;
  x ^= x << 5;
  return *state = x;
}

static inline uint64_t splitmix64(uint64_t *state) {
  uint64_t z = (*state += 0x9e3779b97f4a7c15ULL);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

typedef struct { vu a, b; } stream_t;

static inline void seed_lane(stream_t *stream, int i, uint64_t seed, uint64_t purpose) {
  uint64_t state = seed ^ (purpose * 0xd1342543de82ef95ULL);
  uint64_t a = splitmix64(&state), b = splitmix64(&state);
  memcpy((char *)&stream->a + 8 * i, &a, 8);
  memcpy((char *)&stream->b + 8 * i, &b, 8);
}

/* The stream of a seed at the number k, both integers below 2^51: random access instead of a sequence. */
static inline stream_t stream_at(vd seed, vd k) {
  stream_t stream;
  vu z = bits_of(seed + MAGIC_ROUND) * 0x9e3779b97f4a7c15ULL + bits_of(k + MAGIC_ROUND) * 0xd1342543de82ef95ULL;
  vu *part[2] = {&stream.a, &stream.b};
  for (int i = 0; i < 2; i++) {
    z += 0x9e3779b97f4a7c15ULL;
    vu x = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
    *part[i] = x ^ (x >> 31);
  }
  return stream;
}

static inline vu next_bits(stream_t *s) {
  vu x = s->a, y = s->b;
  s->a = y;
  x ^= x << 23;
  s->b = x ^ y ^ (x >> 18) ^ (y >> 5);
  return s->b + y;
}

/* Sum of the four 16-bit fields of each of three draws: twelve uniforms. */
static inline vd sum_of_twelve(stream_t *s) {
  vu sum = {0};
  for (int i = 0; i < 3; i++) {
    vu x = next_bits(s);
    sum += (x & 0x0000ffff0000ffffULL) + ((x >> 16) & 0x0000ffff0000ffffULL);
  }
  vu total = (sum + (sum >> 32)) & 0xffffffffULL;
  return from_bits(total | 0x4330000000000000ULL) - 4503599627370496.0;
}

/* Standard normal: twelve uniforms with Teichroew's polynomial (Knuth, TAOCP 2, 3.4.1), error below 2e-4. */
static inline vd normal(stream_t *s) {
  vd r = (sum_of_twelve(s) - 12.0 * 32767.5) * (1.0 / (65536.0 * 4.0));
  vd r2 = r * r;
  return ((((0.029899776 * r2 + 0.008355968) * r2 + 0.076542912) * r2 + 0.252408784) * r2 + 3.949846138) * r;
}

#endif
