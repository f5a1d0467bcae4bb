// Rows of numbers: what the time loop computes with.
//
//   Pack    one number for each of several parameter sets, or for each of several runs;
//   Jet<T>  one number and its derivatives: lane 0 is the value, the other lanes are its derivatives with respect to
//           the unknowns, so that linear operations treat all lanes alike.
//
// Equations are templates of either: `Scalar<V>` is what comparisons see, a Pack of values or one value.

#pragma once

#include "pack.h"

namespace sysid {

template <int T>
struct Jet {
  Pack d[T];
  Jet() = default;
  // Copied pack by pack: through registers, not by a call of memmove.
  Jet(const Jet& other) { *this = other; }
  Jet& operator=(const Jet& other) {
    for (int t = 0; t < T; ++t) d[t] = other.d[t];
    return *this;
  }
  void set_value(double x) { d[0][0] = x; }  // in a register: a store to one lane would stall the load of all
  double value() const { return d[0][0]; }
};

template <class V>
struct ScalarOf {
  using type = double;
};
template <>
struct ScalarOf<Pack> {
  using type = Pack;
};
template <class V>
using Scalar = typename ScalarOf<V>::type;

// Where something holds: of the run of each lane, or of one run.
template <class M>
struct WhereOf {
  using type = bool;
};
template <>
struct WhereOf<Pack> {
  using type = Mask;
};
template <class M>
using Where = typename WhereOf<M>::type;
inline Mask opposite(Mask x) { return ~x; }
inline bool opposite(bool x) { return !x; }

// x = 0 there.
inline void clear(Mask where, Pack& x) { x = select(where, Pack{}, x); }
template <class V>
inline void clear(bool where, V& x) {
  if (where) x = V{};
}

// Scalar functions for the values of jets.
inline bool any(bool x) { return x; }
inline double select(bool where, double yes, double no) { return where ? yes : no; }
inline Pack select(bool where, const Pack& yes, const Pack& no) { return where ? yes : no; }
inline bool finite(double x) { return std::isfinite(x); }
inline double absolute(double x) { return std::fabs(x); }
inline double sign_of(double x) { return std::copysign(1.0, x); }
inline double square_root(double x) { return std::sqrt(x); }
inline double exponential(double x) { return exponential(splat(x))[0]; }
inline double positive(double x) { return x <= 0.0 ? 0.0 : x; }
inline double at_most_one(double x) { return x >= 1.0 ? 1.0 : x; }

template <int T>
inline double value(const Jet<T>& x) {
  return x.value();
}

inline Pack first_lane(double x) {
  Pack p = Pack{};
  p[0] = x;
  return p;
}

template <int T>
inline Jet<T> operator+(const Jet<T>& a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a.d[t] + b.d[t];
  return y;
}
template <int T>
inline Jet<T> operator-(const Jet<T>& a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a.d[t] - b.d[t];
  return y;
}
template <int T>
inline Jet<T> operator-(const Jet<T>& a) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = -a.d[t];
  return y;
}
template <int T>
inline Jet<T> operator*(double a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a * b.d[t];
  return y;
}
template <int T>
inline Jet<T>& operator+=(Jet<T>& a, const Jet<T>& b) {
  for (int t = 0; t < T; ++t) a.d[t] += b.d[t];
  return a;
}
// sum += a x, where many a are zero: worth a look for a jet.
inline void accumulate(Pack& sum, double a, const Pack& x) { sum += a * x; }
inline void accumulate(Pack& sum, const Pack& a, const Pack& x) { sum += a * x; }
template <int T>
inline void accumulate(Jet<T>& sum, double a, const Jet<T>& x) {
  if (a == 0.0) return;
  for (int t = 0; t < T; ++t) sum.d[t] += a * x.d[t];
}
template <int T>
inline Jet<T> operator+(double c, const Jet<T>& x) {
  Jet<T> y = x;
  y.d[0] += first_lane(c);
  return y;
}

// (ab)' = a b' + b a'
template <int T>
inline Jet<T> operator*(const Jet<T>& a, const Jet<T>& b) {
  const double av = a.value(), bv = b.value();
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = av * b.d[t] + bv * a.d[t];
  y.d[0] -= first_lane(av * bv);
  return y;
}
// (a/b)' = (a' - (a/b) b') / b
template <int T>
inline Jet<T> operator/(const Jet<T>& a, const Jet<T>& b) {
  const double inverse = 1.0 / b.value(), ratio = a.value() * inverse;
  return ratio + inverse * (a - ratio * b);
}

// f(x) from its value and its slope f'(x).
template <int T>
inline Jet<T> chained(const Jet<T>& x, double value, double slope) {
  Jet<T> y = slope * x;
  y.set_value(value);
  return y;
}

inline Pack reciprocal(const Pack& a) { return 1.0 / a; }
template <int T>
inline Jet<T> reciprocal(const Jet<T>& a) {
  const double inverse = 1.0 / a.value();
  return chained(a, inverse, -inverse * inverse);
}
template <int T>
inline Jet<T> square_root(const Jet<T>& x) {
  const double root = std::sqrt(x.value());
  return chained(x, root, 0.5 / root);
}
template <int T>
inline Jet<T> reciprocal_root(const Jet<T>& x) {
  const double found = 1.0 / std::sqrt(x.value());
  return chained(x, found, -0.5 * found * found * found);
}
template <int T>
inline Jet<T> exponential(const Jet<T>& x) {
  const double found = exponential(x.value());
  return chained(x, found, found);
}
template <int T>
inline Jet<T> absolute(const Jet<T>& x) {
  return sign_of(x.value()) * x;
}
template <int T>
inline Jet<T> select(bool where, const Jet<T>& yes, const Jet<T>& no) {
  return where ? yes : no;
}
template <int T>
inline Jet<T> positive(const Jet<T>& x) {
  return x.value() <= 0.0 ? Jet<T>{} : x;
}

// A row that does not depend on the unknowns.
template <class V>
inline V constant_row(Scalar<V> x);
template <>
inline Pack constant_row<Pack>(Pack x) {
  return x;
}
template <class V>
inline V constant_row(Scalar<V> x) {
  V y{};
  y.set_value(x);
  return y;
}

}  // namespace sysid
