// A pack of doubles that the processor handles as one, and the functions of it that the vehicle's equations need.
//
// Lane by lane every function gives the same result whatever the other lanes hold.

#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#if defined(__AVX__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace sysid {

#if defined(__AVX512F__) && defined(__AVX512DQ__)
constexpr int kLanes = 8;
#elif defined(__AVX__)
constexpr int kLanes = 4;
#else
constexpr int kLanes = 2;
#endif

typedef double Pack __attribute__((vector_size(kLanes * 8)));
typedef int64_t Mask __attribute__((vector_size(kLanes * 8)));  // all bits of a lane set: true
typedef uint64_t Bits __attribute__((vector_size(kLanes * 8)));

inline Pack splat(double x) { return x - Pack{}; }

inline Pack select(Mask where, Pack yes, Pack no) { return where ? yes : no; }

// Number k of a pack, whether something holds in lane k; a single value stands for every k.
inline double at_lane(const Pack& x, int k) { return x[k]; }
inline double at_lane(double x, int) { return x; }
inline bool at_lane(const Mask& x, int k) { return x[k] != 0; }
inline bool at_lane(bool x, int) { return x; }
inline void set_lane(Pack& x, int k, double value) { x[k] = value; }
inline void set_lane(double& x, int, double value) { x = value; }

inline bool any(Mask m) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
  return _mm512_movepi64_mask((__m512i)m) != 0;
#elif defined(__AVX__)
  return _mm256_movemask_pd((__m256d)m) != 0;
#else
  int64_t found = 0;
  for (int k = 0; k < kLanes; ++k) found |= m[k];
  return found != 0;
#endif
}

// While it lives, numbers of its thread that are too small to be normal count as zero: they are remainders of
// exponentials, and processors take many times as long for them.
class NoSubnormals {
#if defined(__SSE2__)
 public:
  NoSubnormals() : before_(_mm_getcsr()) { _mm_setcsr(before_ | 0x8040); }  // flush results, take arguments as zero
  ~NoSubnormals() { _mm_setcsr(before_); }
  NoSubnormals(const NoSubnormals&) = delete;
  NoSubnormals& operator=(const NoSubnormals&) = delete;

 private:
  unsigned before_;
#endif
};

inline Pack absolute(Pack x) { return (Pack)((Bits)x & (~uint64_t{0} >> 1)); }

// 1 with the sign of x; +1 for zero.
inline Pack sign_of(Pack x) { return (Pack)(((Bits)x & (uint64_t{1} << 63)) | (Bits)splat(1.0)); }

inline Pack square_root(Pack x) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
  // Unmasked, GCC 12 warns of the intrinsic's own uninitialised operand; this compiles to the same instruction.
  return (Pack)_mm512_maskz_sqrt_pd((__mmask8)-1, (__m512d)x);
#elif defined(__AVX__)
  return (Pack)_mm256_sqrt_pd((__m256d)x);
#else
  Pack root;
  for (int k = 0; k < kLanes; ++k) root[k] = std::sqrt(x[k]);
  return root;
#endif
}

#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define SYSID_SCALES
// Instructions that take numbers apart: x = 2^e m with m in [1, 2), x = k + f with the nearest integer k, and x 2^k.
constexpr __mmask8 kEvery = static_cast<__mmask8>(-1);
constexpr int kNearest = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
inline Pack exponent_of(Pack x) { return (Pack)_mm512_maskz_getexp_pd(kEvery, (__m512d)x); }
inline Pack mantissa_of(Pack x) {
  return (Pack)_mm512_maskz_getmant_pd(kEvery, (__m512d)x, _MM_MANT_NORM_1_2, _MM_MANT_SIGN_src);
}
inline Pack integer_of(Pack x) { return (Pack)_mm512_maskz_roundscale_pd(kEvery, (__m512d)x, kNearest); }
inline Pack fraction_of(Pack x) { return (Pack)_mm512_maskz_reduce_pd(kEvery, (__m512d)x, kNearest); }
inline Pack scaled(Pack x, Pack k) { return (Pack)_mm512_maskz_scalef_pd(kEvery, (__m512d)x, (__m512d)k); }
// 1 / sqrt(x) to 14 bits.
inline Pack rough_reciprocal_root(Pack x) { return (Pack)_mm512_maskz_rsqrt14_pd(kEvery, (__m512d)x); }
#endif

// 1 / sqrt(x) for normal x > 0.
inline Pack reciprocal_root(Pack x) {
#if defined(SYSID_SCALES)
  // Each step of Newton's doubles the number of bits: no division, no root.
  Pack y = rough_reciprocal_root(x);
  const Pack half = 0.5 * x;
  y += y * (0.5 - half * y * y);
  y += y * (0.5 - half * y * y);
  return y;
#else
  return 1.0 / square_root(x);
#endif
}

// Largest of x and 0, and smallest of x and 1; a lane that is not a number stays so.
inline Pack positive(Pack x) { return select(x <= 0.0, Pack{}, x); }
inline Pack at_most_one(Pack x) { return select(x >= 1.0, splat(1.0), x); }

// (2 / ln 2) artanh s for |s| <= 0.1716: s P(s^2), P through the Chebyshev points, off by 9e-17.
inline Pack artanh_series(Pack s) {
  const Pack z = s * s, z2 = z * z;
  const Pack p01 = 2.885390081777927 + z * 0.9617966939243245;
  const Pack p23 = 0.5770780172508729 + z * 0.4121984013068434;
  const Pack p45 = 0.3206164421244846 + z * 0.26144245557136553;
  return s * (p01 + z2 * (p23 + z2 * (p45 + z2 * 0.24293824606326322)));
}

// 2^f for |f| <= 1/2: polynomial through the Chebyshev points, off by 6e-18.
inline Pack small_power_of_two(Pack f) {
  const Pack f2 = f * f, f4 = f2 * f2;
  const Pack p01 = 1.0 + f * 0.6931471805599453;
  const Pack p23 = 0.24022650695910097 + f * 0.0555041086648216;
  const Pack p45 = 0.009618129107606888 + f * 0.0013333558146416936;
  const Pack p67 = 0.0001540353044173605 + f * 1.525273382983612e-05;
  const Pack p89 = 1.321544258792169e-06 + f * 1.0178062445845774e-07;
  const Pack pab = 7.072585949269223e-09 + f * 4.4549605981865186e-10;
  return (p01 + f2 * p23) + f4 * ((p45 + f2 * p67) + f4 * (p89 + f2 * pab));
}

// log2 x for normal x > 0; 0 gives minus infinity.  With x = 2^e m, m in [sqrt(1/2), sqrt(2)), s = (m - 1) / (m + 1):
//   log2 x = e + log2 m,   log2 m = (2 / ln 2) artanh s.
// 2^x = 2^k 2^f with the nearest integer k.
#if defined(SYSID_SCALES)

inline Pack binary_logarithm(Pack x) {
  constexpr double kRoot = 1.4142135623730951;
  const Pack moved = x * kRoot, m = mantissa_of(moved);
  return exponent_of(moved) + artanh_series((m - kRoot) / (m + kRoot));
}

inline Pack power_of_two(Pack x) { return scaled(small_power_of_two(fraction_of(x)), integer_of(x)); }

#else

inline Pack binary_logarithm(Pack x) {
  constexpr uint64_t kHalfRoot = 0x3fe6a09e667f3bcdULL;  // sqrt(1/2)
  constexpr uint64_t kBias = uint64_t{1023} << 52;
  const Bits biased = ((Bits)x + (kBias - kHalfRoot)) >> 52;
  const Pack m = (Pack)((Bits)x - ((biased << 52) - kBias));
  // An integer below 2^52 put under the exponent of 2^52 is 2^52 plus that integer.
  const Pack e = (Pack)(biased | 0x4330000000000000ULL) - (4503599627370496.0 + 1023.0);
  return select(x > 0.0, e + artanh_series((m - 1.0) / (m + 1.0)), splat(-std::numeric_limits<double>::infinity()));
}

inline Pack power_of_two(Pack x) {
  constexpr double kShift = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to an integer in the low bits
  const Pack low = select(x < -1022.0, splat(-1022.0), x);
  const Pack clamped = select(low > 1024.0, splat(1024.0), low);
  const Pack shifted = clamped + kShift;
  return (Pack)((Bits)small_power_of_two(clamped - (shifted - kShift)) + ((Bits)shifted << 52));
}

#endif

// e^x; its relative error grows with |x|, where it is small.
inline Pack exponential(Pack x) { return power_of_two(x * 1.4426950408889634); }

// x^n for x >= 0, n > 0, to some units in the last place.
inline Pack power(Pack x, Pack n) { return power_of_two(n * binary_logarithm(x)); }

// A value and its partial derivatives with respect to N inputs, lane by lane.
template <int N>
struct Local {
  Pack v;
  Pack d[N];
};

template <int N>
inline Local<N> constant(Pack v) {
  Local<N> x;
  x.v = v;
  for (int k = 0; k < N; ++k) x.d[k] = Pack{};
  return x;
}

template <int N>
inline Local<N> variable(Pack v, int input) {
  Local<N> x = constant<N>(v);
  x.d[input] = splat(1.0);
  return x;
}

// The value `v` with the derivatives of x times `factor`: the chain rule for one input.
template <int N>
inline Local<N> chained(const Local<N>& x, Pack v, Pack factor) {
  Local<N> y;
  y.v = v;
  for (int k = 0; k < N; ++k) y.d[k] = factor * x.d[k];
  return y;
}

template <int N>
inline Local<N> operator+(const Local<N>& a, const Local<N>& b) {
  Local<N> y;
  y.v = a.v + b.v;
  for (int k = 0; k < N; ++k) y.d[k] = a.d[k] + b.d[k];
  return y;
}

template <int N>
inline Local<N> operator-(const Local<N>& a, const Local<N>& b) {
  Local<N> y;
  y.v = a.v - b.v;
  for (int k = 0; k < N; ++k) y.d[k] = a.d[k] - b.d[k];
  return y;
}

template <int N>
inline Local<N> operator*(const Local<N>& a, const Local<N>& b) {
  Local<N> y;
  y.v = a.v * b.v;
  for (int k = 0; k < N; ++k) y.d[k] = a.v * b.d[k] + b.v * a.d[k];
  return y;
}

template <int N>
inline Local<N> operator/(const Local<N>& a, const Local<N>& b) {
  Local<N> y;
  const Pack inverse = 1.0 / b.v;
  y.v = a.v * inverse;
  for (int k = 0; k < N; ++k) y.d[k] = inverse * (a.d[k] - y.v * b.d[k]);
  return y;
}

template <int N>
inline Local<N> operator+(const Local<N>& a, Pack b) {
  Local<N> y = a;
  y.v += b;
  return y;
}

template <int N>
inline Local<N> operator*(Pack a, const Local<N>& b) {
  return chained(b, a * b.v, a);
}

template <int N>
inline Local<N> operator*(const Local<N>& a, Pack b) {
  return b * a;
}

template <int N>
inline Local<N> operator*(const Local<N>& a, double b) {
  return splat(b) * a;
}

template <int N>
inline Local<N> operator+(Pack a, const Local<N>& b) {
  return b + a;
}

template <int N>
inline Local<N> operator+(const Local<N>& a, double b) {
  return a + splat(b);
}

template <int N>
inline Local<N> operator+(double a, const Local<N>& b) {
  return b + splat(a);
}

template <int N>
inline Local<N> operator*(double a, const Local<N>& b) {
  return splat(a) * b;
}

template <int N>
inline Local<N> operator-(const Local<N>& a) {
  return -1.0 * a;
}

inline Pack value(Pack x) { return x; }
template <int N>
inline Pack value(const Local<N>& x) {
  return x.v;
}

template <int N>
inline Local<N> select(Mask where, const Local<N>& yes, const Local<N>& no) {
  Local<N> y;
  y.v = select(where, yes.v, no.v);
  for (int k = 0; k < N; ++k) y.d[k] = select(where, yes.d[k], no.d[k]);
  return y;
}

template <int N>
inline Local<N> absolute(const Local<N>& x) {
  return chained(x, absolute(x.v), sign_of(x.v));
}

template <int N>
inline Local<N> square_root(const Local<N>& x) {
  const Pack root = square_root(x.v);
  return chained(x, root, 0.5 / root);
}

template <int N>
inline Local<N> reciprocal_root(const Local<N>& x) {
  const Pack found = reciprocal_root(x.v);
  return chained(x, found, -0.5 * found * found * found);
}

// d(x^n) = x^n (n dx / x + ln x dn)
template <int N>
inline Local<N> power(const Local<N>& x, const Local<N>& n) {
  const Pack binary = binary_logarithm(x.v), found = power_of_two(n.v * binary);
  const Pack by_x = found * n.v / x.v, by_n = found * (binary * 0.6931471805599453);
  Local<N> y;
  y.v = found;
  for (int k = 0; k < N; ++k) y.d[k] = by_x * x.d[k] + by_n * n.d[k];
  return y;
}

template <int N>
inline Local<N> positive(const Local<N>& x) {
  return select(x.v <= 0.0, constant<N>(Pack{}), x);
}

}  // namespace sysid
