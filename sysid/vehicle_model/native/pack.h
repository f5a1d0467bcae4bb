// A pack of doubles that the processor handles as one, and the functions of it that the vehicle's equations need.
//
// Lane by lane every function gives the same result whatever the other lanes hold.

#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#if defined(__AVX__)
#include <immintrin.h>
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

// Largest of x and 0, and smallest of x and 1; a lane that is not a number stays so.
inline Pack positive(Pack x) { return select(x <= 0.0, Pack{}, x); }
inline Pack at_most_one(Pack x) { return select(x >= 1.0, splat(1.0), x); }

// ln x for normal x > 0, good to about one unit in the last place: x = 2^e m with m in [sqrt(1/2), sqrt(2)),
// ln m = 2 artanh s = 2 s + s z P(z), s = (m - 1) / (m + 1), z = s^2 (coefficients of fdlibm's e_log.c).
inline Pack logarithm(Pack x) {
  constexpr uint64_t kHalfRoot = 0x3fe6a09e667f3bcdULL;  // sqrt(1/2)
  constexpr uint64_t kBias = uint64_t{1023} << 52;
  const Bits moved = (Bits)x + (kBias - kHalfRoot);
  const Bits biased = moved >> 52;
  const Pack m = (Pack)((Bits)x - ((biased << 52) - kBias));
  // An integer below 2^52 put under the exponent of 2^52 is 2^52 plus that integer.
  const Pack e = (Pack)(biased | 0x4330000000000000ULL) - (4503599627370496.0 + 1023.0);
  const Pack f = m - 1.0;
  const Pack s = f / (f + 2.0);
  const Pack z = s * s, w = z * z;
  const Pack odd = z * (6.666666666666735130e-01 +
                        w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)));
  const Pack even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
  const Pack half = 0.5 * f * f;
  const Pack low = s * (half + (odd + even)) + e * 1.90821492927058770002e-10;
  const Pack found = e * 6.93147180369123816490e-01 - ((half - low) - f);
  return select(x <= std::numeric_limits<double>::max(), found, x);
}

// e^x, good to about one unit in the last place: x = k ln 2 + r, |r| <= ln 2 / 2, and the Taylor series of e^r.
inline Pack exponential(Pack x) {
  constexpr double kShift = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to an integer in the low bits
  const Pack shifted = x * 1.4426950408889634074 + kShift;
  const Pack k = shifted - kShift;
  const Pack r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  const Pack r2 = r * r, r4 = r2 * r2;
  const Pack p01 = 1.0 + r;
  const Pack p23 = 1.0 / 2 + r * (1.0 / 6);
  const Pack p45 = 1.0 / 24 + r * (1.0 / 120);
  const Pack p67 = 1.0 / 720 + r * (1.0 / 5040);
  const Pack p89 = 1.0 / 40320 + r * (1.0 / 362880);
  const Pack pab = 1.0 / 3628800 + r * (1.0 / 39916800);
  const Pack pcd = 1.0 / 479001600 + r * (1.0 / 6227020800.0);
  const Pack series = (p01 + r2 * p23) + r4 * ((p45 + r2 * p67) + r4 * ((p89 + r2 * pab) + r4 * pcd));
  const Pack found = (Pack)((Bits)series + ((Bits)shifted << 52));
  const Pack capped = select(x > 709.0, splat(std::numeric_limits<double>::infinity()), found);
  return select(x < -708.0, Pack{}, capped);
}

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
inline Local<N> logarithm(const Local<N>& x) {
  return chained(x, logarithm(x.v), 1.0 / x.v);
}

template <int N>
inline Local<N> exponential(const Local<N>& x) {
  const Pack found = exponential(x.v);
  return chained(x, found, found);
}

template <int N>
inline Local<N> positive(const Local<N>& x) {
  return select(x.v <= 0.0, constant<N>(Pack{}), x);
}

}  // namespace sysid
